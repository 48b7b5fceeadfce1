"""A YAML list of entries -> checked entries -> run in order.

A parameter may be a reference ``${{id.side_outputs.name}}`` to what an earlier entry found.
Everything that can be known to be wrong is said before the first entry runs, with the place where
it was written and the nearest right word.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from os import PathLike, fspath
from time import perf_counter
from typing import TYPE_CHECKING, Any, TypeAlias

from tomoslam_stage.entries import Entry, apply_settings, load_pipeline, pipeline_names
from tomoslam_stage.errors import PipelineError, nearest
from tomoslam_stage.methods import checked

if TYPE_CHECKING:
    from tomoslam_stage.stages import Stage, Work

    Stages: TypeAlias = Mapping[str, type[Stage]]

__all__ = ["Entry", "apply_settings", "check", "load_pipeline", "pipeline_names", "run"]

log = logging.getLogger(__name__)

OURS = "tomoslam_stage.stages"
SAVE_RESULT = "%s: save_result changes nothing here; the parameters of %s say what is kept"
REFERENCE = re.compile(r"\$\{\{\s*([\w-]+)\.side_outputs\.([\w-]+)\s*\}\}")


def check(entries: Sequence[Entry], stages: Stages) -> list[Stage]:
    """Build the stage of every entry, or say what is wrong with the first that cannot run.

    Parameters that refer to side outputs are left at their defaults: their values are known,
    and checked, when the earlier entry has run.

    Raises
    ------
    PipelineError
        For a module, method, parameter, value, order or reference that cannot be right.
    """
    made: set[str] = set()
    built = []
    for position, entry in enumerate(entries):
        cls = _class_of(entry, stages)
        _check_order(entry, cls, made, stages)
        _check_side_outputs(entry, cls)
        references = _references(entry, entries[:position])
        given = {k: v for k, v in entry.parameters.items() if k not in references}
        built.append(_built(entry, cls, given))
        if entry.save_result is not None:
            log.warning(SAVE_RESULT, entry.origin("save_result"), entry.method)
        made.update(_declared(cls, "makes"))
    return built


def _declared(cls: type[Stage], name: str) -> tuple[str, ...]:
    """Read what a stage class ``needs``, ``makes`` (products) or ``gives`` (side outputs)."""
    return tuple(getattr(cls, name, ()))


def _class_of(entry: Entry, stages: Stages) -> type[Stage]:
    if entry.module_path != OURS:
        found = f"the module_path {entry.module_path!r} is not taken; {OURS} is the only one."
        raise PipelineError(entry.origin("module_path"), found)
    if entry.method not in stages:
        found = f"{OURS} has no method {entry.method!r}."
        raise PipelineError(entry.origin("method"), found, nearest(entry.method, stages))
    return stages[entry.method]


def _check_order(entry: Entry, cls: type[Stage], made: set[str], stages: Stages) -> None:
    for product in _declared(cls, "needs"):
        if product not in made:
            makers = [
                name for name, maker in stages.items() if product in _declared(maker, "makes")
            ]
            found = f"{entry.name} needs the {product}, which no earlier entry makes."
            remedy = f"Put {' or '.join(makers)} before it." if makers else ""
            raise PipelineError(entry.where, found, remedy)


def _check_side_outputs(entry: Entry, cls: type[Stage]) -> None:
    gives = _declared(cls, "gives")
    for output in entry.side_outputs:
        if output not in gives:
            found = f"{entry.method} has no side output {output!r}."
            remedy = nearest(output, gives) if gives else "It has none at all."
            raise PipelineError(entry.origin("side_outputs"), found, remedy)


def _references(entry: Entry, earlier: Sequence[Entry]) -> dict[str, tuple[str, str]]:
    """Parameter -> (id, name) of the side output it refers to, all of them checked."""
    outputs = {e.id: set(e.side_outputs.values()) for e in earlier if e.id is not None}
    found = {}
    for key, item in entry.parameters.items():
        match = REFERENCE.fullmatch(item) if isinstance(item, str) else None
        where = entry.origin(f"parameters.{key}")
        if match is None:
            _check_no_reference(item, where)
            continue
        source, name = match.groups()
        if source not in outputs:
            remedy = nearest(source, outputs) if outputs else "None of them has an id."
            raise PipelineError(where, f"no earlier entry has the id {source!r}.", remedy)
        if name not in outputs[source]:
            remedy = nearest(name, outputs[source]) if outputs[source] else "It lists none."
            raise PipelineError(where, f"{source} has no side output {name!r}.", remedy)
        found[key] = (source, name)
    return found


def _check_no_reference(item: Any, where: str) -> None:
    if isinstance(item, str) and "${{" in item:
        needed = "${{id.side_outputs.name}} as the whole value of a parameter is needed."
        raise PipelineError(where, f"the reference {item!r} cannot be read; {needed}")
    if isinstance(item, Mapping | list):
        for inner in item.values() if isinstance(item, Mapping) else item:
            _check_no_reference(inner, where)


def _built(entry: Entry, cls: type[Stage], parameters: Mapping[str, Any]) -> Stage:
    try:
        return checked(cls, parameters, entry.name)
    except PipelineError as error:
        raise PipelineError(_blamed(entry, cls, parameters, str(error)), str(error)) from error


def _blamed(entry: Entry, cls: type[Stage], parameters: Mapping[str, Any], message: str) -> str:
    """Where the parameter was written that alone gives the same message; else the entry."""
    for key, item in parameters.items():
        try:
            checked(cls, {key: item}, entry.name)
        except PipelineError as error:
            if str(error) == message:
                return entry.origin(f"parameters.{key}")
    return entry.where


def run(entries: Sequence[Entry], work: Work, stages: Stages) -> None:
    """Check all entries, then run them in order on `work`.

    A failure stops the entries that need what the failed one should have made, and no others:
    a report that cannot be drawn does not cost the angles, nor the other way round. The first
    failure is raised once the others have run.
    """
    built = check(entries, stages)
    work.pipeline[:] = [described(e, stage) for e, stage in zip(entries, built, strict=True)]
    state = _Run(entries, work, stages)
    for position in range(len(entries)):
        state.attempt(position)
    for error in state.failures.values():
        raise error


@dataclass
class _Run:
    """What one run has come to so far."""

    entries: Sequence[Entry]
    work: Work
    stages: Stages
    outputs: dict[tuple[str, str], Any] = field(default_factory=dict)
    """(id, name) -> value of a side output."""
    lost: set[str] = field(default_factory=set)
    """What failed entries should have made."""
    failures: dict[str, Exception] = field(default_factory=dict)
    """By name of the entry, in order."""

    def attempt(self, position: int) -> None:
        """Run an entry unless what it needs is lost; keep its failure for later."""
        entry = self.entries[position]
        cls = self.stages[entry.method]
        references = _references(entry, self.entries[:position])
        needs = {*_declared(cls, "needs"), *(_outputs_of(id_) for id_, _ in references.values())}
        makes = {*_declared(cls, "makes"), _outputs_of(entry.name)}
        if needs & self.lost:
            log.debug("%s is left out: no %s", entry.name, ", ".join(sorted(needs & self.lost)))
            self.lost |= makes
            return
        if self.failures:
            log.warning("%s failed; %s does without it", " and ".join(self.failures), entry.name)
        try:
            self._run(position, references)
        except Exception as error:
            if self.failures:  # only the first is raised
                log.error("%s: %s", entry.name, error)
            self.failures.setdefault(entry.name, error)
            self.lost |= makes

    def _run(self, position: int, references: Mapping[str, tuple[str, str]]) -> None:
        entry = self.entries[position]
        values = {key: self.outputs[source] for key, source in references.items()}
        stage = _built(entry, self.stages[entry.method], {**entry.parameters, **values})
        begin, known = perf_counter(), sum(self.work.seconds.values())
        try:
            given = stage.run(self.work)
        finally:
            took = perf_counter() - begin
            # A stage may have told the time of its stations; the rest is its own.
            own = took - (sum(self.work.seconds.values()) - known)
            self.work.seconds[entry.name] = self.work.seconds.get(entry.name, 0.0) + own
        log.info("%s took %.1f s", entry.name, took)
        for output, name in entry.side_outputs.items():
            self.outputs[entry.name, name] = given[output]


def _outputs_of(name: str) -> str:
    return f"side outputs of {name}"


def described(entry: Entry, stage: Stage) -> dict[str, Any]:
    """Entry as plain YAML data, every default of its stage filled in, references as written."""
    plain = _plain(stage)
    for key, item in entry.parameters.items():
        if isinstance(item, str) and REFERENCE.fullmatch(item):
            plain[key] = item
    whole = {
        "method": entry.method,
        "module_path": entry.module_path,
        "parameters": plain,
        "id": entry.id,
        "side_outputs": dict(entry.side_outputs) or None,
        "save_result": entry.save_result,
    }
    return {key: item for key, item in whole.items() if item is not None}


def _plain(item: Any) -> Any:
    """YAML data of a value; a dataclass is the mapping of its fields, or what it says itself."""
    if is_dataclass(item):
        if hasattr(item, "described"):
            return _plain(item.described())
        return {f.name: _field(item, f.name) for f in fields(item)}
    if isinstance(item, Mapping):
        return {key: _plain(inner) for key, inner in item.items()}
    if isinstance(item, list | tuple):
        return [_plain(inner) for inner in item]
    return fspath(item) if isinstance(item, PathLike) else item


def _field(item: Any, name: str) -> Any:
    """YAML data of a field; where it does not say which method it holds, the data does."""
    value = getattr(item, name)
    plain = _plain(value)
    declared = getattr(item, "__pydantic_fields__", {}).get(name)
    if is_dataclass(value) and (declared is None or declared.annotation is not type(value)):
        return {
            "method": re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", type(value).__name__).lower()
        } | plain
    return plain
