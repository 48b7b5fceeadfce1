"""Contents, template, style and scripts become one file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from html import escape
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from tomoslam_stage.comparison.writing import write_atomically

if TYPE_CHECKING:
    from pathlib import Path

SCRIPTS = (
    "data.js",
    "pixels.js",
    "pointers.js",
    "viewer.js",
    "charts.js",
    "player.js",
    "facts.js",
    "start.js",
)
"""In the order in which they use each other."""


def write_page(path: Path, made: Mapping[str, Any]) -> None:
    """Write the page that shows `made`, see `contents`."""
    write_atomically(path, page(made).encode())


def page(made: Mapping[str, Any]) -> str:
    """Put everything into the template."""
    beside = files("tomoslam_stage.comparison.page")
    # "</script>" may stand in a name that a user chose; "<" never does once this is done.
    data = json.dumps(made, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    parts = {
        "title": escape(f"{made['report']['scan']['name']} · {made['verdict']}"),
        "style": (beside / "page.css").read_text("utf-8"),
        "scripts": "\n".join((beside / name).read_text("utf-8") for name in SCRIPTS),
        "data": data,
    }
    template = (beside / "template.html").read_text("utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda mark: parts[mark[1]], template)
