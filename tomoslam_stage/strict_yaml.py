"""YAML read strictly: one document of plain values, no key twice, no bomb, every line known.

`compose` gives checked nodes, which know their line; `value` turns a node into plain data. Nothing
but the types of JSON is ever made. Numbers follow YAML 1.2: ``1e-3`` is a number, ``10:50:10`` and
``2026-05-01`` are texts.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, TypeAlias

import yaml

from tomoslam_stage.errors import PipelineError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Node: TypeAlias = yaml.Node
    Places: TypeAlias = Callable[[int], str]
    """Line number, from 1 -> what a message calls the place."""

MAX_CHARACTERS = 100_000
MAX_VALUES = 10_000
MAX_DEPTH = 20

CORE = "tag:yaml.org,2002:"
SWEEPS = ("!Sweep", "!SweepRange")
"""HTTomo's tags for many values of one parameter."""
MERGE = f"{CORE}merge"
PLAIN_TAGS: dict[type[yaml.Node], set[str]] = {
    yaml.ScalarNode: {CORE + name for name in ("null", "bool", "int", "float", "str")},
    yaml.SequenceNode: {f"{CORE}seq"},
    yaml.MappingNode: {f"{CORE}map"},
}


class _PlainLoader(yaml.SafeLoader):
    """The safe loader without the surprises of YAML 1.1 (``1:30`` is 90, ``1e-3`` is a text)."""

    def resolve(self, kind: type[yaml.Node], value: str | None, implicit: Any) -> str:
        tag: str = super().resolve(kind, value, implicit)  # type: ignore[no-untyped-call]
        dated = tag in (f"{CORE}timestamp", f"{CORE}value")
        base_60 = tag in (f"{CORE}int", f"{CORE}float") and ":" in (value or "")
        return f"{CORE}str" if dated or base_60 else tag


_PlainLoader.add_implicit_resolver(
    f"{CORE}float", re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+\Z"), list("-+0123456789")
)


def compose(text: str, at: Places) -> Node | None:
    """Read the one document in `text`, checked; None if there is nothing in it.

    Raises
    ------
    PipelineError
        For text that is no YAML, more than one document, a key given twice, a tag that asks for
        anything but plain data, or more values than a pipeline can need.
    """
    if len(text) > MAX_CHARACTERS:
        raise PipelineError(
            at(1), f"{len(text)} characters; a pipeline has at most {MAX_CHARACTERS}."
        )
    try:
        loader = _PlainLoader(text)
        root = loader.get_single_node()
        if root is not None:
            _check(root, at)
            _merge(loader, root)
    except yaml.MarkedYAMLError as error:
        raise PipelineError(at(_line(error.problem_mark)), f"{error.problem}.") from error
    except yaml.YAMLError as error:
        raise PipelineError(at(1), f"no YAML text: {error}.") from error
    except RecursionError as error:
        raise PipelineError(at(1), f"nested more than {MAX_DEPTH} deep.") from error
    return root


def value(node: Node | None) -> Any:
    """Plain data of a node that `compose` gave."""
    return None if node is None else yaml.constructor.SafeConstructor().construct_document(node)


def line(node: Node) -> int:
    """Line of a node, from 1."""
    return _line(node.start_mark)


def pairs(node: yaml.MappingNode) -> dict[str, tuple[Node, Node]]:
    """Key -> (node of the key, node of its value); of a merged and an own key the own one."""
    return {key.value: (key, item) for key, item in node.value}


def _line(mark: yaml.Mark | None) -> int:
    return 1 if mark is None else mark.line + 1


def _walk(node: Node, depth: int = 0) -> Iterator[tuple[Node, int]]:
    """All nodes below `node` with their depth, each as often as aliases repeat it."""
    yield node, depth
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            yield from _walk(item, depth + 1)
    elif isinstance(node, yaml.MappingNode):
        for _, item in node.value:
            yield from _walk(item, depth + 1)


def _check(root: Node, at: Places) -> None:
    for count, (node, depth) in enumerate(_walk(root)):
        where = at(line(node))
        if count > MAX_VALUES:
            raise PipelineError(where, f"more than {MAX_VALUES} values once aliases are followed.")
        if depth > MAX_DEPTH:
            raise PipelineError(where, f"nested more than {MAX_DEPTH} deep.")
        _check_plain(node, where)
        if isinstance(node, yaml.MappingNode):
            _check_keys(node, at)


def _check_plain(node: Node, where: str) -> None:
    if node.tag in SWEEPS:
        found = f"{node.tag} is not taken: one run refines a scan with one value of each parameter."
        raise PipelineError(where, found, "Give one value, and run once for each of the others.")
    if node.tag not in PLAIN_TAGS[type(node)]:
        tag = node.tag.replace(CORE, "!!")
        raise PipelineError(where, f"the tag {tag} is not taken; only plain values are.")
    if isinstance(node, yaml.ScalarNode):
        try:
            value(node)
        except (ValueError, KeyError) as error:
            tag = node.tag.replace(CORE, "!!")
            raise PipelineError(where, f"{node.value[:40]!r} is no {tag}.") from error


def _check_keys(node: yaml.MappingNode, at: Places) -> None:
    first: dict[str, int] = {}
    for key, _ in node.value:
        if key.tag not in (f"{CORE}str", MERGE):
            raise PipelineError(at(line(key)), f"{_shown(key)} is no key; a key is a word.")
        if key.value in first:
            raise PipelineError(
                at(line(key)),
                f"the key {key.value!r} is given twice, first in line {first[key.value]}.",
                "Leave one of them out.",
            )
        first[key.value] = line(key)


def _shown(key: Node) -> str:
    return repr(key.value) if isinstance(key, yaml.ScalarNode) else "a list or mapping"


def _merge(loader: _PlainLoader, root: Node) -> None:
    """Replace the ``<<`` keys by what they stand for, in place."""
    for node, _ in _walk(root):
        if isinstance(node, yaml.MappingNode):
            loader.flatten_mapping(node)
