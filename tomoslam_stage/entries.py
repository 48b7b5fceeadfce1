"""The entries of a pipeline as they are written: in YAML, and on the command line.

The grammar is HTTomo's: a list of entries with ``method``, ``module_path``, ``parameters`` and,
where wanted, ``id``, ``side_outputs`` (output of the method: its name in the pipeline) and
``save_result``. Each entry remembers where it was written, for the messages of `pipeline`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from tomoslam_stage import strict_yaml
from tomoslam_stage.errors import PipelineError, nearest

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

NAME = re.compile(r"[\w-]+")
KEYS: dict[str, tuple[type, str]] = {
    "method": (str, "a name"),
    "module_path": (str, "a name"),
    "parameters": (dict, "a mapping"),
    "id": (str, "a name"),
    "side_outputs": (dict, "a mapping"),
    "save_result": (bool, "true or false"),
}
REQUIRED = ("method", "module_path")


@dataclass(frozen=True)
class Entry:
    """One entry of a pipeline, as it was written."""

    method: str
    module_path: str
    where: str
    """File and line, for messages."""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    origins: Mapping[str, str] = field(default_factory=dict)
    """Key or parameter -> file and line, or the ``--set`` it came from."""
    id: str | None = None
    side_outputs: Mapping[str, str] = field(default_factory=dict)
    """Output of the method -> its name in the pipeline."""
    save_result: bool | None = None

    @property
    def name(self) -> str:
        """What the entry is called in messages and in settings."""
        return self.id or self.method

    def origin(self, key: str) -> str:
        """Where `key`, a parameter or a key of the entry, was written."""
        return self.origins.get(key, self.where)


def pipeline_names() -> list[str]:
    """Names of the pipelines that come with the package."""
    names = (entry.name for entry in _carried().iterdir())
    return sorted(name.removesuffix(".yaml") for name in names if name.endswith(".yaml"))


def load_pipeline(name_or_path: str | Path) -> list[Entry]:
    """Read a pipeline that comes with the package by its name, any other from its file.

    Raises
    ------
    PipelineError
        If there is no such pipeline, or it does not follow the grammar.
    """
    text, file = _text_of(name_or_path)
    root = strict_yaml.compose(text, lambda line: f"{file}:{line}")
    if not isinstance(root, yaml.SequenceNode) or not root.value:
        raise PipelineError(f"{file}:1", "no list of entries; a pipeline needs one or more.")
    entries = [_entry(node, file) for node in root.value]
    _check_ids(entries)
    return entries


def _carried() -> Traversable:
    """Folder of our pipelines: inside the package once installed, beside it in a checkout."""
    inside = files("tomoslam_stage") / "pipelines"
    return inside if inside.is_dir() else Path(__file__).parents[1] / "pipelines"


def _text_of(name_or_path: str | Path) -> tuple[str, str]:
    known = pipeline_names()
    if name_or_path in known:
        return (_carried() / f"{name_or_path}.yaml").read_text("utf-8"), f"{name_or_path}.yaml"
    path = Path(name_or_path)
    if not path.is_file():
        wanted = "a name or a YAML file is needed."
        remedy = nearest(str(name_or_path), known)
        raise PipelineError(str(name_or_path), f"no such pipeline; {wanted}", remedy)
    size = path.stat().st_size
    if size > strict_yaml.MAX_CHARACTERS:  # the scan in the pipeline's place, for instance
        limit = f"a pipeline has at most {strict_yaml.MAX_CHARACTERS}."
        raise PipelineError(str(path), f"{size} bytes; {limit}")
    try:
        return path.read_text("utf-8-sig"), str(path)
    except UnicodeDecodeError as error:
        raise PipelineError(str(path), "not a text in UTF-8; a YAML file is needed.") from error


def _entry(node: yaml.Node, file: str) -> Entry:
    where = f"{file}:{strict_yaml.line(node)}"
    if not isinstance(node, yaml.MappingNode):
        raise PipelineError(where, "no entry; an entry is a mapping that has a 'method'.")
    said = strict_yaml.pairs(node)
    origins = {key: f"{file}:{strict_yaml.line(at)}" for key, (at, _) in said.items()}
    values = {key: strict_yaml.value(item) for key, (_, item) in said.items()}
    _check_keys(values, origins, where)
    parameters = said["parameters"][1] if "parameters" in said else None
    if isinstance(parameters, yaml.MappingNode):
        for key, (at, _) in strict_yaml.pairs(parameters).items():
            origins[f"parameters.{key}"] = f"{file}:{strict_yaml.line(at)}"
    given = {key: item for key, item in values.items() if item is not None}
    return Entry(**given, where=where, origins=origins)


def _check_keys(values: Mapping[str, Any], origins: Mapping[str, str], where: str) -> None:
    for key, item in values.items():
        if key not in KEYS:
            raise PipelineError(origins[key], f"an entry has no key {key!r}.", nearest(key, KEYS))
        kind, called = KEYS[key]
        if not isinstance(item, kind if key in REQUIRED else (kind, type(None))):
            raise PipelineError(origins[key], f"{key} is {item!r}; {called} is needed.")
    for key in REQUIRED:
        if key not in values:
            raise PipelineError(where, f"the entry has no {key!r}; {KEYS[key][1]} is needed.")
    for output, name in (values.get("side_outputs") or {}).items():
        if not isinstance(name, str) or not NAME.fullmatch(name):
            found = f"the side output {output!r} is called {name!r}; a word is needed."
            raise PipelineError(origins["side_outputs"], found)


def _check_ids(entries: Sequence[Entry]) -> None:
    first: dict[str, Entry] = {}
    for entry in entries:
        if entry.id is None:
            continue
        if not NAME.fullmatch(entry.id):
            found = f"the id {entry.id!r} is no word of letters, digits, '_' and '-'."
            raise PipelineError(entry.origin("id"), found)
        if entry.id in first:
            found = f"the id {entry.id!r} is taken by the entry at {first[entry.id].where}."
            raise PipelineError(entry.origin("id"), found, "Ids are unique; choose another.")
        first[entry.id] = entry


def apply_settings(entries: Sequence[Entry], settings: Sequence[str]) -> list[Entry]:
    """Change parameters as ``ENTRY.PARAMETER=VALUE`` says, VALUE being YAML, later ones last.

    ``refine_theta.detector.keypoints=500`` reaches into the detector; ENTRY is an id or a method.

    Raises
    ------
    PipelineError
        If there is no such entry or no way down to the parameter. Whether the parameter itself
        exists is for `check` to say.
    """
    changed = list(entries)
    for setting in settings:
        where = f"--set {setting}"
        (name, *keys), given = read_setting(setting)
        if not keys:
            example = "ENTRY.PARAMETER=VALUE is needed, as in refine_theta.steps_deg=[4,10]."
            raise PipelineError(where, f"no parameter of {name}; {example}")
        index = _index(changed, name, where)
        entry = changed[index]
        changed[index] = replace(
            entry,
            parameters=placed(entry.parameters, keys, given, where),
            origins={**entry.origins, f"parameters.{keys[0]}": where},
        )
    return changed


def read_setting(setting: str) -> tuple[list[str], Any]:
    """Read ``A.B=VALUE``: the path of keys and the value, which is YAML."""
    where = f"--set {setting}"
    target, equals, text = setting.partition("=")
    keys = [key.strip() for key in target.split(".")]
    if not (equals and all(keys)):
        raise PipelineError(where, "no setting; KEY=VALUE is needed.")
    return keys, strict_yaml.value(strict_yaml.compose(text, lambda _: where))


def _index(entries: Sequence[Entry], name: str, where: str) -> int:
    by_id = [i for i, entry in enumerate(entries) if entry.id == name]
    found = by_id or [i for i, entry in enumerate(entries) if entry.method == name]
    if not found:
        known = {entry.name for entry in entries}
        raise PipelineError(where, f"the pipeline has no entry {name!r}.", nearest(name, known))
    if len(found) > 1:
        lines = " and ".join(entries[i].where for i in found)
        raise PipelineError(where, f"{name!r} may be {lines}.", "Give them ids and use those.")
    return found[0]


def placed(
    parameters: Mapping[str, Any], keys: Sequence[str], given: Any, where: str
) -> dict[str, Any]:
    """Return `parameters` with `given` at the end of the path `keys`."""
    head, *rest = keys
    if not rest:
        return {**parameters, head: given}
    inner = parameters.get(head)
    if inner is None:
        inner = {}
    elif isinstance(inner, str):  # a method by its name alone
        inner = {"method": inner}
    if not isinstance(inner, Mapping):
        raise PipelineError(where, f"{head} is {inner!r}, which has no {rest[0]!r}.")
    return {**parameters, head: placed(inner, rest, given, where)}
