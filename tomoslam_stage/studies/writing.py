"""The files of a study, and the page of all of them."""

from __future__ import annotations

import csv
from base64 import b64encode
from html import escape
from io import StringIO
from typing import TYPE_CHECKING, Any

from tomoslam_stage.comparison import canvas, versions
from tomoslam_stage.comparison.plain import as_json, plain
from tomoslam_stage.comparison.writing import write_atomically
from tomoslam_stage.studies.study import Claim

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from tomoslam_stage.studies.case import Case
    from tomoslam_stage.studies.study import Outcome, Study

HEADS = ("", "published", "reproduced", "our best")
STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; max-width: 70rem; margin: 2rem auto;
  padding: 0 1rem }
h1 { font-size: 1.6rem } h2 { font-size: 1.25rem; margin-top: 2.5rem }
table { border-collapse: collapse; margin: 1rem 0 }
th, td { text-align: left; padding: .35rem .8rem; border-bottom: 1px solid #ddd }
img { width: 100%; border: 1px solid #ddd } .numbers { overflow-x: auto; font-size: .8rem }
"""


def write_outcome(folder: Path, name: str, study: Study, case: Case, outcome: Outcome) -> None:
    """Write NAME.png, NAME.csv and NAME.json into `folder`.

    Raises
    ------
    PipelineError
        If one of them cannot be written.
    """
    canvas.save(outcome.figure, folder / f"{name}.png")
    write_atomically(folder / f"{name}.csv", as_csv(outcome.table))
    facts = {
        "study": name,
        "case": case.origin,
        "parameters": study,
        "conclusion": outcome.conclusion,
        "numbers": outcome.numbers,
        "table": outcome.table,
        "versions": versions(),
    }
    write_atomically(folder / f"{name}.json", as_json(plain(facts)))


def as_csv(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Write rows that all have the same keys."""
    text = StringIO()
    if rows:
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return text.getvalue().encode()


def write_page(folder: Path, case: Case, outcomes: Mapping[str, Outcome]) -> None:
    """Write index.html, one file with all pictures in it, and its first table as table.md.

    Raises
    ------
    PipelineError
        If one of them cannot be written, or a picture of `outcomes` is not in `folder`.
    """
    claims = [claim for outcome in outcomes.values() for claim in outcome.claims]
    write_atomically(folder / "table.md", markdown(claims).encode())
    sections = [section(folder, name, outcome) for name, outcome in outcomes.items()]
    title = "The published experiments, re-run"
    versions_said = ", ".join(f"{name} {v}" for name, v in versions().items() if v)
    body = [
        f"<h1>{title}</h1>",
        f"<p>{escape(case.origin)}</p>",
        html_table(HEADS, claims),
        "<p>Published: Griguletskii et al., TomoSLAM, section 5. Reproduced: the published method "
        "(SURF, minimal sample, pipeline paper), run here. Our best: SIFT, features that are "
        "followed, the default pipeline.</p>",
        *sections,
        f"<p><small>{escape(versions_said)}</small></p>",
    ]
    head = f'<meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
    page = "\n".join(["<!doctype html>", '<html lang="en">', head, *body, "</html>"])
    write_atomically(folder / "index.html", page.encode())


def section(folder: Path, name: str, outcome: Outcome) -> str:
    """Return what the page says about one study."""
    picture = b64encode((folder / f"{name}.png").read_bytes()).decode()
    rows = [[shown(cell) for cell in row.values()] for row in outcome.table]
    heads = list(outcome.table[0]) if outcome.table else []
    return "\n".join(
        [
            f'<h2 id="{name}">{name}</h2>',
            f"<p>{escape(outcome.conclusion)}</p>",
            f'<img alt="{name}" src="data:image/png;base64,{picture}">',
            f"<details><summary>numbers ({name}.csv)</summary>",
            f'<div class="numbers">{html_table(heads, rows)}</div></details>',
        ]
    )


def shown(cell: Any) -> str:
    """Write a number short."""
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def html_table(heads: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table."""
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    lines = ["".join(f"<td>{escape(text)}</td>" for text in row) for row in rows]
    body = "\n".join(f"<tr>{line}</tr>" for line in lines)
    return f"<table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>"


def markdown(claims: Iterable[Claim]) -> str:
    """Return the table that the README shows."""
    lines = [HEADS, ("---",) * len(HEADS), *claims]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
