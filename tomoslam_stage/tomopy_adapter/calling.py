"""Calls of the functions that an entry of a pipeline may name."""

from __future__ import annotations

import inspect
import os
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.errors import PipelineError, nearest
from tomoslam_stage.tomopy_adapter.allowed import allowed
from tomoslam_stage.tomopy_adapter.installed import module

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from tomoslam_stage.products import Along, Pixels

OURS = frozenset({"ncore", "nchunk", "out", "sinogram_order"})
"""Parameters of many functions that say how to work, not what to do."""
AXES: Mapping[Any, Along] = {0: "projection", 1: "row"}


def along(module_path: str, function: str, given: Mapping[str, Any]) -> Along:
    """Return what blocks must hold whole for `function`, called with `given`.

    Raises
    ------
    PipelineError
        For an ``axis`` across all blocks, or a function that is not allowed.
    """
    how = allowed(module_path, function, function)
    axis = given.get("axis", 0)
    if how.by_axis and axis not in AXES:
        wanted = "0 (each projection) or 1 (each row) is needed."
        raise PipelineError(f"{function}.axis", f"{axis!r}; {wanted}")
    return AXES[axis] if how.by_axis else how.along


def keywords(module_path: str, function: str) -> Mapping[str, inspect.Parameter]:
    """Return the parameters of `function` that a user may set; those without default must be set.

    Raises
    ------
    PipelineError
        If it is not allowed.
    BackendMissingError
        If tomopy is not installed.
    """
    how = allowed(module_path, function, function)
    _stack, *others = _parameters(module_path, function).values()
    taken = OURS.union(how.filled, how.withheld)
    return {parameter.name: parameter for parameter in others if parameter.name not in taken}


def fills(module_path: str, function: str) -> frozenset[str]:
    """Return the parameters that are filled in: ``flat``, ``dark``, ``theta``, ``ncore``.

    Errors as of `keywords`; `call` fills ``ncore`` where nobody does.
    """
    how = allowed(module_path, function, function)
    return frozenset({"ncore"}.intersection(_parameters(module_path, function)).union(how.filled))


def recon_keywords(algorithm: str) -> frozenset[str]:
    """Return the parameters that ``tomopy.recon.algorithm.recon`` takes for `algorithm`.

    Raises
    ------
    PipelineError
        If tomopy has no such algorithm; the message says which is meant.
    BackendMissingError
        If tomopy is not installed.
    """
    source = module("tomopy.recon.algorithm")
    known = source.allowed_recon_kwargs
    if algorithm not in known:
        raise PipelineError("algorithm", f"tomopy has no {algorithm!r}.", nearest(algorithm, known))
    accelerated = source.allowed_accelerated_kwargs.get(algorithm, ())
    return frozenset(known[algorithm]).union(accelerated)


def call(module_path: str, function: str, block: Pixels, **parameters: Any) -> Pixels | float:
    """Return what `function` makes of a block, which stays as it is; or the number it finds there.

    One call at a time: tomopy works through global variables, on all cores by itself.

    Parameters
    ----------
    module_path, function
        One that is allowed.
    block
        (projection, row, column) whole `along` what it needs. One that finds a number gets the row
        where it is to look, or several to look at their mean.
    **parameters
        What the user set, and what it `fills`.

    Raises
    ------
    PipelineError
        If it fails, or returns another shape.
    BackendMissingError
        If tomopy is not installed.
    """
    how = allowed(module_path, function, function)
    if "ncore" in _parameters(module_path, function):
        parameters.setdefault("ncore", os.cpu_count())
    if how.finds:
        block = block.mean(axis=1, keepdims=True)
        parameters["ind"] = 0
    made = _called(module_path, function, np.array(block, np.float32), parameters)
    return _number(made, function) if how.finds else _stack(made, block, function)


def _parameters(module_path: str, function: str) -> Mapping[str, inspect.Parameter]:
    return inspect.signature(getattr(module(module_path), function)).parameters


def _called(module_path: str, function: str, block: Pixels, parameters: dict[str, Any]) -> Any:
    """Call `function`; what goes wrong in there is most often a parameter that does not fit."""
    chosen = getattr(module(module_path), function)
    try:
        return chosen(block, **parameters)
    except (TypeError, ValueError, IndexError, ArithmeticError) as error:
        raise PipelineError(function, f"tomopy says: {error}.", "Check its parameters.") from error


def _number(found: Any, function: str) -> float:
    if np.size(found) != 1:
        raise PipelineError(function, f"returned {np.shape(found)}; one number is needed.")
    return float(np.reshape(found, ()))


def _stack(made: Any, block: NDArray[np.float32], function: str) -> Pixels:
    if np.shape(made) != block.shape:
        found = f"made {np.shape(made)} of {block.shape}; the shape must stay."
        raise PipelineError(function, found)
    return np.asarray(made, np.float32)
