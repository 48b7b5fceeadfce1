"""What all commands share: their options, and how they show what they were given."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, RawDescriptionHelpFormatter
from pathlib import Path

PROGRAM = "python -m tomoslam_stage"
PIPELINE_HELP = "default, fast, paper, sirt or stripes, which come with the package, or a YAML file"


def new_parser(program: str, description: str, epilog: str = "") -> ArgumentParser:
    """Make a parser with the options that every command has."""
    parser = ArgumentParser(
        prog=program,
        description=description,
        epilog=epilog,
        formatter_class=RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--log", type=Path, metavar="FILE", help="append log lines to a file")
    parser.add_argument("-v", "--verbose", action="store_true", help="say more")
    return parser


def add_set(parser: ArgumentParser, text: str) -> None:
    """Let parameters be changed by ``--set KEY=VALUE``, which `text` explains."""
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=text)


def row_list(text: str) -> list[int]:
    """Read ``10,50,100``, or ``10:100:10`` as in Python: from, before, step."""
    try:
        if ":" in text:
            start, stop, *step = (int(part) for part in text.split(":"))
            rows = list(range(start, stop, *step[:1])) if len(step) < 2 else []
        else:
            rows = [int(part) for part in text.split(",")]
    except ValueError:
        rows = []
    if not rows or min(rows) < 0:
        needed = "10,50,100 or FROM:BEFORE:STEP is needed"
        raise ArgumentTypeError(f"{text!r} names no rows; {needed}")
    return rows


def one_line(text: str) -> str:
    """Return `text` without what would break the line, or command the terminal."""
    return "".join(each if each.isprintable() else "?" for each in " ".join(text.split()))
