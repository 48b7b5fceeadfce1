"""How a method is chosen by name: a visible table of frozen dataclasses.

A method is one frozen pydantic dataclass whose fields are its parameters. A table maps names to
such classes; `build` makes one from what a pipeline says, and answers a wrong name or key with the
nearest right one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast, dataclass_transform

from pydantic import BeforeValidator, ConfigDict, ValidationError
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tomoslam_stage.errors import PipelineError, nearest

Method = TypeVar("Method")

STRICT = ConfigDict(extra="forbid", arbitrary_types_allowed=True, allow_inf_nan=False)
"""No unknown parameters, no number without end; fields may be of any type, as another method."""


@dataclass_transform(frozen_default=True, kw_only_default=True)
def method(cls: type[Method]) -> type[Method]:
    """Make `cls` a method: a frozen dataclass that checks its parameters and takes no others."""
    checking = pydantic_dataclass(frozen=True, config=STRICT, kw_only=True)(cls)
    return cast(type[Method], checking)


def build(table: Mapping[str, type[Method]], spec: str | Mapping[str, Any], where: str) -> Method:
    """Make the method that `spec` names: ``"sift"`` or ``{"method": "sift", "keypoints": 500}``.

    Raises
    ------
    PipelineError
        If the name or a key is unknown, or a value does not fit.
    """
    chosen = {"method": spec} if isinstance(spec, str) else dict(spec)
    name = chosen.pop("method", None)
    if not isinstance(name, str) or name not in table:
        raise PipelineError(where, f"no method {name!r}.", nearest(str(name), table))
    return checked(table[name], chosen, f"{where}.{name}")


def checked(cls: type[Method], parameters: Mapping[str, Any], where: str) -> Method:
    """Make `cls` from `parameters`, or say which parameter is wrong and what would be right.

    Raises
    ------
    PipelineError
        For an unknown key or a value of the wrong type or range.
    """
    known = list(getattr(cls, "__dataclass_fields__", {}))
    for key in parameters:
        if key not in known:
            raise PipelineError(where, f"no parameter {key!r}.", nearest(str(key), known))
    try:
        made = cls(**parameters)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join([where, *map(str, first["loc"])])
        if first["type"] == "missing":
            raise PipelineError(key, "is missing; a value is needed.") from error
        raise PipelineError(key, f"{first['input']!r} does not fit: {first['msg']}.") from error
    for switch in _taken_for_numbers(parameters, made):
        found = "a switch (true, false, yes, no, on, off) does not fit; a number is needed."
        raise PipelineError(f"{where}.{switch}", found)
    return made


def _taken_for_numbers(given: Any, made: Any) -> Iterator[str]:
    """Where `given` has switches that became numbers in `made`: to pydantic, true is 1."""
    for key, item, became in _beside(given, made):
        number = isinstance(became, int | float) and not isinstance(became, bool)
        if isinstance(item, bool) and number:
            yield str(key)
        elif isinstance(item, Mapping | list | tuple):
            yield from (f"{key}.{inner}" for inner in _taken_for_numbers(item, became))


def _beside(given: Any, made: Any) -> Iterator[tuple[Any, Any, Any]]:
    """Keys of a mapping or places in a list, what was `given` there and what was `made` of it."""
    if not isinstance(given, Mapping):
        items = zip(given, made, strict=False) if isinstance(made, Sequence) else ()
        yield from ((place, *pair) for place, pair in enumerate(items))
    elif isinstance(made, Mapping):
        yield from ((key, item, made.get(key)) for key, item in given.items())
    else:
        yield from ((key, item, getattr(made, key, None)) for key, item in given.items())


@dataclass(frozen=True, slots=True)
class FromTable(BeforeValidator):
    """Makes methods of a table, which whoever describes the field can read off."""

    table: Mapping[str, type[Any]] = field(kw_only=True)
    every: bool = False
    """Whether the field holds a mapping of all of them by name, and not a single one."""


def chosen_from(table: Mapping[str, type[Any]], where: str) -> FromTable:
    """Let a field take a name or a mapping and make the method of `table` that it means."""

    def choose(spec: Any) -> Any:
        return build(table, spec, where) if isinstance(spec, str | Mapping) else spec

    return FromTable(choose, table=table)


def name_of(chosen: object, table: Mapping[str, type[Any]]) -> str:
    """Return the name under which `table` knows the class of `chosen`."""
    return next(name for name, cls in table.items() if cls is type(chosen))
