"""What an entry of a pipeline may say: every option with its type, default, range and meaning.

It is read off the stages themselves, as a JSON schema by which editors complete and check YAML, and
from that as text.
"""

from __future__ import annotations

import ast
import inspect
import json
import textwrap
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

import annotated_types
from pydantic import BeforeValidator
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from tomoslam_stage.entries import KEYS, REQUIRED
from tomoslam_stage.errors import PipelineError, nearest
from tomoslam_stage.methods import FromTable
from tomoslam_stage.stages import MODULES, STAGES

Schema: TypeAlias = dict[str, Any]

DIALECT = "https://json-schema.org/draft/2020-12/schema"
REFERENCE: Schema = {"type": "string", "pattern": r"^\s*\$\{\{.*\}\}\s*$"}
"""A side output of an earlier entry, which may stand for any parameter."""
NAMES: Mapping[Any, str] = {
    bool: "boolean",
    int: "integer",
    float: "number",
    str: "string",
    Path: "string",
    type(None): "null",
}
LIMITS: Mapping[type[Any], tuple[str, str]] = {
    annotated_types.Ge: ("ge", "minimum"),
    annotated_types.Gt: ("gt", "exclusiveMinimum"),
    annotated_types.Le: ("le", "maximum"),
    annotated_types.Lt: ("lt", "exclusiveMaximum"),
}
SIGNS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
WIDTH = 96


def schema() -> Schema:
    """Return the JSON schema of a pipeline."""
    rules = [
        {
            "if": {"properties": {"module_path": {"const": path}, "method": {"const": name}}},
            "then": {"properties": {"parameters": {"anyOf": [parameters, {"type": "null"}]}}},
        }
        for path, name, parameters in _described()
    ]
    keys = {key: _typed(kind) for key, (kind, _) in KEYS.items()}
    keys["module_path"] = {"enum": list(MODULES)}
    keys["method"] = {"enum": sorted({name for m in MODULES.values() for name in m.stages})}
    entry: Schema = {"type": "object", "properties": keys, "required": list(REQUIRED)}
    entry |= {"additionalProperties": False, "allOf": rules}
    return {"$schema": DIALECT, "title": "pipeline", "type": "array", "minItems": 1, "items": entry}


def _typed(kind: type[Any]) -> Schema:
    return {"type": ["object" if kind is dict else NAMES[kind], "null"]}


def _described() -> Iterator[tuple[str, str, Schema]]:
    """Yield module, method and the schema of its parameters, a reference allowed for each.

    Functions of tomopy have the parameters that tomopy gives them, which only `check` knows.
    """
    for path, module in MODULES.items():
        for name in module.stages:
            if (path, name) in OURS:
                said = of_method(module.stages[name])
                options = said["properties"].items()
                said["properties"] = {key: _or_reference(option) for key, option in options}
                yield path, name, said


OURS = {
    *(("tomoslam_stage.stages", name) for name in STAGES),
    ("httomo.data.hdf.loaders", "standard_tomo"),
    ("tomopy.recon.algorithm", "recon"),
}
"""Module and method of all entries whose parameters are ours."""


def _or_reference(option: Schema) -> Schema:
    told: Schema = {key: option[key] for key in ("description", "default") if key in option}
    return {"anyOf": [option, REFERENCE]} | told


def of_method(cls: type[Any]) -> Schema:
    """Return the schema of the parameters of a method."""
    docs = documented(cls)
    infos: Mapping[str, FieldInfo] = cls.__pydantic_fields__
    options = {
        name: of_type(info.annotation, info.metadata) | _told(docs.get(name, ""), info)
        for name, info in infos.items()
    }
    said = {"type": "object", "properties": options, "additionalProperties": False}
    required = [name for name, info in infos.items() if info.is_required()]
    meaning = inspect.getdoc(cls) or ""
    described: Schema = said | {"description": meaning}
    return described | {"required": required} if required else described


def _told(doc: str, info: FieldInfo) -> Schema:
    told: Schema = {"description": doc}
    if not info.is_required():
        told["default"] = _plain(info.get_default(call_default_factory=True), info.metadata)
    return told


def _plain(value: Any, metadata: list[Any]) -> Any:
    """Return a default as YAML says it: a chosen method by its name, sections as mappings."""
    table = _table(metadata)
    if table is not None and not table.every:
        return next(name for name, cls in table.table.items() if cls is type(value))
    if is_dataclass(value):
        infos = getattr(type(value), "__pydantic_fields__", {})
        return {
            f.name: _plain(getattr(value, f.name), infos[f.name].metadata) for f in fields(value)
        }
    if isinstance(value, Mapping):
        return {key: _plain(inner, []) for key, inner in value.items()}
    return list(value) if isinstance(value, tuple) else value


def of_type(kind: Any, metadata: list[Any] | tuple[Any, ...] = ()) -> Schema:
    """Return the schema of what a field of type `kind` takes."""
    table = _table(metadata)
    if table is not None:
        return _of_table(table)
    for each in metadata:
        taken = getattr(each, "json_schema_input_type", PydanticUndefined)
        if isinstance(each, BeforeValidator) and taken is not PydanticUndefined:
            return of_type(taken)
    said = _of_plain_type(kind)
    for each in metadata:
        if type(each) in LIMITS:
            attribute, key = LIMITS[type(each)]
            said[key] = getattr(each, attribute)
    return said


def _of_plain_type(kind: Any) -> Schema:
    origin, inside = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        found = [m for each in inside[1:] for m in getattr(each, "metadata", [each])]
        return of_type(inside[0], found)
    if origin is typing.Literal:
        return {"enum": list(inside)}
    if origin in (typing.Union, types.UnionType):
        return {"anyOf": [of_type(each) for each in inside]}
    if origin in (tuple, list):
        return {"type": "array", "items": of_type(inside[0])}
    if is_dataclass(kind):
        return of_method(typing.cast(type[Any], kind))
    name = "object" if origin is not None else NAMES.get(kind)
    return {"type": name} if name else {}


def _table(metadata: list[Any] | tuple[Any, ...]) -> FromTable | None:
    return next((each for each in metadata if isinstance(each, FromTable)), None)


def _of_table(found: FromTable) -> Schema:
    methods = {name: of_method(cls) for name, cls in found.table.items()}
    if found.every:
        return {"type": "object", "properties": methods, "additionalProperties": False}
    for name, said in methods.items():
        said["properties"] = {"method": {"const": name}, **said["properties"]}
        said["required"] = ["method", *said.get("required", [])]
    return {"anyOf": [{"enum": list(methods)}, *methods.values()]}


def documented(cls: type[Any]) -> Mapping[str, str]:
    """Name of each field -> the text below it in the source, in one paragraph."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    body = tree.body if isinstance(tree, ast.ClassDef) else []
    found = {}
    for said, below in pairwise(body):
        match said, below:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=doc)):
                found[name] = " ".join(str(doc).split())
    return found


def overview() -> str:
    """Name what may be described, each with the first line about it."""
    rows = [(name, of_method(MODULES[path].stages[name])) for path, name in sorted(OURS)]
    lines = [f"{name:<14} {_text(said['description']).splitlines()[0]}" for name, said in rows]
    return "\n".join(sorted(lines))


def described(place: str) -> str:
    """Describe an entry, or with dots between the names a section or an option of it.

    Raises
    ------
    PipelineError
        If there is nothing of that name.
    """
    first, *rest = place.split(".")
    known = {name: path for path, name in OURS}
    if first not in known:
        raise PipelineError("describe", f"no entry {first!r}.", nearest(first, known))
    said = of_method(MODULES[known[first]].stages[first])
    for i, name in enumerate(rest):
        inner = dict(_sections(said))
        if name not in inner:
            where = ".".join([first, *rest[:i]])
            raise PipelineError("describe", f"{where} has no {name!r}.", nearest(name, inner))
        said = inner[name]
    head = [f"{place}: {_text(said.get('description', ''))}", ""]
    if not any(True for _ in _sections(said)):
        head[1] = f"  {_kind(said)}; {_default(said)}"
    return "\n".join([*head, *_lines(said, "  ")]).rstrip()


def _sections(said: Schema) -> Iterator[tuple[str, Schema]]:
    """Yield what `said` holds by name: options and, where there is a choice, methods."""
    yield from said.get("properties", {}).items()
    for option in said.get("anyOf", []):
        inner = dict(option.get("properties", {}))
        chosen = inner.pop("method", {}).get("const")
        if chosen is not None:
            yield chosen, {**option, "properties": inner}
        else:
            yield from inner.items()


def _lines(said: Schema, margin: str) -> Iterator[str]:
    for name, option in _sections(said):
        sections = dict(_sections(option))
        facts = [_kind(option), _default(option)] if "default" in option else [_kind(option)]
        if sections and "enum" not in option.get("anyOf", [{}])[0]:
            nullable = {"type": "null"} in option.get("anyOf", [])
            facts = ["section, or null"] if nullable else ["section"]
        yield f"{margin}{name}: {'; '.join(facts)}"
        room = WIDTH - len(margin) - 4
        yield from textwrap.wrap(
            " ".join(_text(option.get("description", "")).split()),
            room,
            initial_indent=f"{margin}    ",
            subsequent_indent=f"{margin}    ",
        )
        yield from _lines(option, f"{margin}  ")


def _text(doc: str) -> str:
    return doc.replace("``", "").replace("`", "")


def _default(option: Schema) -> str:
    if "default" not in option:
        return "required"
    return f"default {_yaml(option['default'])}"


def _yaml(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_yaml, value))}]"
    named = value is None or isinstance(value, bool) or value == ""
    return json.dumps(value) if named else str(value)


def _kind(option: Schema) -> str:
    """Say in words what may be given."""
    if "enum" in option:
        return "one of " + ", ".join(map(str, option["enum"]))
    if "anyOf" in option:
        return " or ".join(dict.fromkeys(_kind(each) for each in option["anyOf"]))
    if option.get("type") == "array":
        return f"list of {_kind(option['items'])}"
    limits = " and ".join(f"{sign} {option[key]}" for key, sign in SIGNS.items() if key in option)
    kind = {"object": "mapping", "string": "text"}.get(option.get("type", ""), option.get("type"))
    return " ".join(filter(None, (kind or "anything", limits)))
