"""A YAML list of entries -> checked entries -> run in order.

A parameter may be a reference ``${{id.side_outputs.name}}`` to what an earlier entry found.
Everything that can be known to be wrong is said before the first entry runs, with the place where
it was written and the nearest right word.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from os import PathLike, fspath
from time import perf_counter
from typing import TYPE_CHECKING, Any

from tomoslam_stage.entries import Entry, apply_settings, load_pipeline, pipeline_names
from tomoslam_stage.errors import PipelineError, nearest
from tomoslam_stage.methods import checked

if TYPE_CHECKING:
    from pathlib import Path

    from tomoslam_stage.products import Scan, Values
    from tomoslam_stage.stages import Modules, Stage, Work

__all__ = [
    "Entry",
    "apply_settings",
    "check",
    "check_on_scan",
    "load_pipeline",
    "pipeline_names",
    "run",
]

log = logging.getLogger(__name__)

OURS = "tomoslam_stage.stages"
SAVE_RESULT = "%s: save_result changes nothing here; the parameters of %s say what is kept"
REFERENCE = re.compile(r"\$\{\{\s*([\w-]+)\.side_outputs\.([\w-]+)\s*\}\}")


def check(entries: Sequence[Entry], modules: Modules) -> list[Stage]:
    """Build the stage of every entry, or say what is wrong with the first that cannot run.

    Parameters that refer to side outputs are left at their defaults: their values are known,
    and checked, when the earlier entry has run.

    Raises
    ------
    PipelineError
        For a module, method, parameter, value, order or reference that cannot be right.
    BackendMissingError
        For an entry that needs what is not installed.
    """
    made: set[str] = set()
    built = []
    for position, entry in enumerate(entries):
        cls = _class_of(entry, modules)
        _check_order(entry, cls, made, modules)
        _check_side_outputs(entry, cls)
        references = _references(entry, entries[:position])
        given = {k: v for k, v in entry.parameters.items() if k not in references}
        built.append(_built(entry, cls, given))
        if entry.save_result is not None:
            log.warning(SAVE_RESULT, entry.origin("save_result"), entry.method)
        made.update(_declared(cls, "makes"))
    _check_values(entries, built)
    return built


def check_on_scan(entries: Sequence[Entry], modules: Modules, path: Path) -> Scan:
    """Check all entries, and whether they fit the scan at `path`, which is only read.

    Raises
    ------
    StageError
        As `check` does, and for a scan that cannot be used.
    """
    from tomoslam_stage.stages import Fitted, Loader

    built = check(entries, modules)
    loader = next((stage for stage in built if isinstance(stage, Loader)), None)
    if loader is None:
        raise PipelineError(entries[0].where, "no entry loads a scan.", "Begin with load_scan.")
    scan = loader.opened(path)
    _check_values(entries, built, (scan.values,))
    for entry, stage in zip(entries, built, strict=True):
        if isinstance(stage, Fitted):
            with _told_where(entry):
                stage.check_fits(scan)
    return scan


@contextmanager
def _told_where(entry: Entry) -> Iterator[None]:
    """Say of a refusal, which begins with ``stage.parameter``, where that was written."""
    try:
        yield
    except PipelineError as error:
        parameter = str(error).partition(":")[0].rpartition(".")[2]
        raise PipelineError(entry.origin(f"parameters.{parameter}"), str(error)) from error


def _check_values(
    entries: Sequence[Entry], built: Sequence[Stage], loaded: tuple[Values, ...] | None = None
) -> None:
    """Follow what the projections hold from entry to entry: the logarithm is taken only once.

    `loaded` is what the scan is known to hold; without it, whatever its loader may leave.
    """
    values: tuple[Values, ...] = ()
    for entry, stage in zip(entries, built, strict=True):
        takes = getattr(stage, "takes", values)
        taken = [value for value in values if value in takes]
        if values and not taken:
            found = f"{entry.name} takes {_listed(takes)}, and gets {_listed(values)} here."
            raise PipelineError(entry.where, found, "Leave it out, or put it elsewhere.")
        made = tuple(getattr(stage, "leaves", taken))
        values = loaded if loaded and not values else made


def _listed(values: Sequence[Values]) -> str:
    return " or ".join(value.replace("_", " ") for value in values)


def _declared(cls: type[Stage], name: str) -> tuple[str, ...]:
    """Read what a stage class ``needs``, ``makes`` (products) or ``gives`` (side outputs)."""
    return tuple(getattr(cls, name, ()))


def _class_of(entry: Entry, modules: Modules) -> type[Stage]:
    path, name = entry.module_path, entry.method
    if path not in modules:
        found = f"the module_path {path!r} is not taken."
        raise PipelineError(entry.origin("module_path"), found, nearest(path, modules))
    module = modules[path]
    if name in module.refused:
        found = f"{path}.{name} can be no entry: it {module.refused[name]}."
        raise PipelineError(entry.origin("method"), found)
    if name not in module.stages:
        found = f"{path} has no method {name!r}."
        raise PipelineError(entry.origin("method"), found, nearest(name, module.stages))
    module.require(entry.origin("method"))
    return module.stages[name]


def _check_order(entry: Entry, cls: type[Stage], made: set[str], modules: Modules) -> None:
    for product in _declared(cls, "needs"):
        if product not in made:
            ours = modules[OURS].stages
            makers = [name for name, maker in ours.items() if product in _declared(maker, "makes")]
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


def run(entries: Sequence[Entry], work: Work, modules: Modules) -> None:
    """Check all entries, then run them in order on `work`.

    A failure stops the entries that need what the failed one should have made, and no others:
    a report that cannot be drawn does not cost the angles, nor the other way round. The first
    failure is raised once the others have run.
    """
    built = check(entries, modules)
    work.pipeline[:] = [described(e, stage) for e, stage in zip(entries, built, strict=True)]
    state = _Run(entries, work, modules)
    for position, stage in enumerate(built):
        state.attempt(position)
        if "scan" in _declared(type(stage), "makes") and not state.failures:
            _check_writable(built[position + 1 :], work)
    for error in state.failures.values():
        raise error


def _check_writable(later: Sequence[Stage], work: Work) -> None:
    """Refuse, once the scan is known to be sound, what could not be written in the end."""
    from tomoslam_stage.stages import Writer

    for stage in later:
        if isinstance(stage, Writer):
            stage.check_writable(work)


@dataclass
class _Run:
    """What one run has come to so far."""

    entries: Sequence[Entry]
    work: Work
    modules: Modules
    outputs: dict[tuple[str, str], Any] = field(default_factory=dict)
    """(id, name) -> value of a side output."""
    lost: set[str] = field(default_factory=set)
    """What failed entries should have made."""
    failures: dict[str, Exception] = field(default_factory=dict)
    """By name of the entry, in order."""

    def attempt(self, position: int) -> None:
        """Run an entry unless what it needs is lost; keep its failure for later."""
        entry = self.entries[position]
        cls = _class_of(entry, self.modules)
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
        stage = _built(entry, _class_of(entry, self.modules), {**entry.parameters, **values})
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
    alone = (type(value), type(value) | None)  # the field takes nothing else
    if is_dataclass(value) and (declared is None or declared.annotation not in alone):
        return {
            "method": re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", type(value).__name__).lower()
        } | plain
    return plain
