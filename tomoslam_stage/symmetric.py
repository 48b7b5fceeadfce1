"""Symmetric matrices that tie every projection to every other, worked on in place.

Of a scan of 5000 projections each takes 200 MB: no step may leave copies behind.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tomoslam_stage.products import Floats

BLOCK = 256
"""Rows that are worked on at once where copies are needed."""


def blocks(size: int) -> Iterator[slice]:
    """Cut `size` rows into blocks."""
    return (slice(start, min(start + BLOCK, size)) for start in range(0, size, BLOCK))


def symmetrise(matrix: Floats) -> None:
    """Make `matrix` (k, k) the mean of itself and its transpose."""
    for rows in blocks(len(matrix)):
        beside = slice(rows.start, None)
        mean = (matrix[rows, beside] + matrix[beside, rows].T) / 2
        matrix[rows, beside] = mean
        matrix[beside, rows] = mean.T


def add_outer(matrix: Floats, vector: Floats, factor: float) -> None:
    """Add the outer product of `vector` (k,) with itself, `factor` times, to `matrix` (k, k)."""
    for rows in blocks(len(matrix)):
        matrix[rows] += factor * (vector[rows, None] * vector)


def add_gram(matrix: Floats, rows: Floats, factor: float) -> None:
    """Add the product of the transpose of `rows` (m, k) with itself to `matrix` (k, k)."""
    for some in blocks(len(matrix)):
        here, after = rows[:, some], slice(some.stop, None)
        matrix[some, some] += factor * (here.T @ here)
        beside = factor * (here.T @ rows[:, after])
        matrix[some, after] += beside
        matrix[after, some] += beside.T


def factorised(matrix: Floats) -> Floats:
    """(k, k) the root U of ``U.T @ U`` that is `matrix`, which is used up; for the functions below.

    Raises
    ------
    LinAlgError
        If `matrix` is not positive definite, or holds what is no number.
    """
    from scipy.linalg.lapack import dpotrf

    # LAPACK stores columns one after the other.
    root, order = dpotrf(matrix.T, lower=0, clean=0, overwrite_a=1)
    # What is no number need not stop it, but spreads to the diagonal.
    if order or not np.isfinite(np.diag(root)).all():
        raise np.linalg.LinAlgError("the matrix is not positive definite")
    return np.asarray(root)


def solved(root: Floats, right: Floats) -> Floats:
    """(k,) or (k, m) what the matrix of `root`, see `factorised`, makes `right` of."""
    from scipy.linalg import cho_solve

    return np.asarray(cho_solve((root, False), right, check_finite=False))


def halfway(root: Floats, right: Floats) -> Floats:
    """(k, m) what the inverse of the transpose of `root` makes `right` of, which is used up."""
    from scipy.linalg.blas import dtrsm

    # From the right on the transpose, as that lies in memory in columns.
    return np.asarray(dtrsm(1.0, root, right.T, side=1, lower=0, overwrite_b=1)).T


def inverse(root: Floats) -> Floats:
    """(k, k) the inverse of the matrix of `root`, see `factorised`, which is used up."""
    from scipy.linalg.lapack import dpotri

    upper, _ = dpotri(root, lower=0, overwrite_c=1)
    for rows in blocks(len(upper)):
        upper[rows.stop :, rows] = upper[rows, rows.stop :].T
        corner = np.triu(upper[rows, rows])
        upper[rows, rows] = corner + np.triu(corner, 1).T
    return np.asarray(upper)
