"""Symmetric matrices in place, against what numpy makes of copies."""

from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage import symmetric
from tomoslam_stage.products import Floats
from tomoslam_stage.symmetric import (
    add_gram,
    add_outer,
    factorised,
    halfway,
    inverse,
    solved,
    symmetrise,
)

SIZES = [1, 7, 8, 20]
"""Below, at and beyond one block of rows."""


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(symmetric, "BLOCK", 7)


def random(*shape: int) -> Floats:
    return np.random.default_rng(5).normal(size=shape)


def positive(size: int) -> Floats:
    root = random(size, size)
    return np.asarray(root @ root.T + size * np.eye(size))


@pytest.mark.parametrize("size", SIZES)
def test_what_is_added_is_added_to_either_half_alike(size: int) -> None:
    start, vector, rows = positive(size), random(size), random(3, size)
    matrix = start.copy()
    add_outer(matrix, vector, -0.3)
    add_gram(matrix, rows, 2.0)
    expected = start - 0.3 * np.outer(vector, vector) + 2 * rows.T @ rows
    np.testing.assert_allclose(matrix, expected, atol=1e-12)
    assert np.array_equal(matrix - matrix.T, start - start.T)


@pytest.mark.parametrize("size", SIZES)
def test_a_matrix_made_symmetric_is_the_mean_of_both_its_halves(size: int) -> None:
    matrix = random(size, size)
    expected = (matrix + matrix.T) / 2
    symmetrise(matrix)
    assert np.array_equal(matrix, expected)


@pytest.mark.parametrize("size", SIZES)
def test_a_root_solves_goes_halfway_and_inverts(size: int) -> None:
    matrix, right = positive(size), random(size, 4)
    root = factorised(matrix.copy())
    np.testing.assert_allclose(solved(root, right), np.linalg.solve(matrix, right))
    half = halfway(root, right.copy())
    np.testing.assert_allclose(half.T @ half, right.T @ np.linalg.solve(matrix, right), atol=1e-12)
    np.testing.assert_allclose(inverse(root), np.linalg.inv(matrix), atol=1e-14)


def test_roots_and_inverses_take_the_place_of_the_matrix() -> None:
    matrix, right = positive(20), random(20, 4)
    root = factorised(matrix)
    assert np.shares_memory(root, matrix)
    assert np.shares_memory(halfway(root, right), right)
    assert np.shares_memory(inverse(root), matrix)


@pytest.mark.parametrize("wrong", [-1.0, 0.0, np.nan])
def test_what_has_no_root_is_an_error(wrong: float) -> None:
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        factorised(np.diag([1.0, 1.0, wrong, 1.0]))
    beside = np.eye(20)
    beside[3, 15] = beside[15, 3] = wrong * 2
    if wrong:
        with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
            factorised(beside)
