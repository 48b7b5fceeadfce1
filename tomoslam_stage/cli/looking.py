"""Commands that look at a pipeline or a scan, and the one that puts angles back."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tomoslam_stage.cli.arguments import PIPELINE_HELP, add_set, new_parser
from tomoslam_stage.errors import DONE, ScanError


def check_parser(program: str) -> ArgumentParser:
    """Make the parser of ``check``."""
    text = "Say what is wrong with a pipeline, and whether it fits a scan; nothing is done."
    parser = new_parser(program, text)
    parser.add_argument("pipeline", metavar="PIPELINE", help=PIPELINE_HELP)
    parser.add_argument(
        "scan", type=Path, nargs="?", metavar="SCAN", help="DXchange (HDF5) file it should fit"
    )
    add_set(parser, "change a parameter first, as in refine_theta.width=320; may be repeated")
    return parser


def check(args: Namespace) -> int:
    """Check a pipeline, alone or on a scan, and list its entries."""
    from tomoslam_stage.pipeline import apply_settings, check, check_on_scan, load_pipeline
    from tomoslam_stage.stages import MODULES

    entries = apply_settings(load_pipeline(args.pipeline), args.set)
    if args.scan is None:
        check(entries, MODULES)
    else:
        check_on_scan(entries, MODULES, args.scan)
    places = max(len(entry.where) for entry in entries)
    names = max(len(entry.name) for entry in entries)
    for entry in entries:
        said = f"{entry.module_path}.{entry.method}"
        print(f"{entry.where:<{places}}  {entry.name:<{names}}  {said}")
    fits = "" if args.scan is None else f" and fits {args.scan.name}"
    print(f"{args.pipeline}: {len(entries)} entries; the pipeline can run{fits}")
    return DONE


def inspect_parser(program: str) -> ArgumentParser:
    """Make the parser of ``inspect``."""
    parser = new_parser(program, "Say what is in a scan, and what is wrong with it (exit code 3).")
    parser.add_argument("scan", type=Path, metavar="SCAN", help="DXchange (HDF5) file")
    return parser


def inspect(args: Namespace) -> int:
    """Print the facts of a scan."""
    from tomoslam_stage.scans import describe_scan

    facts = describe_scan(args.scan)
    print(table(facts))
    return ScanError.exit_code if facts["problems"] else DONE


def table(facts: Mapping[str, Any]) -> str:
    """Lay out facts in two columns; an item of a list of texts has a line of its own."""
    width = max(map(len, facts)) + 2
    lines = []
    for key, fact in facts.items():
        texts = fact if isinstance(fact, list) and all(isinstance(f, str) for f in fact) else [fact]
        labels = [key.replace("_", " "), *[""] * (len(texts) - 1)]
        lines += [
            f"{a:<{width}}{_shown(b)}" for a, b in zip(labels, texts or ["none"], strict=True)
        ]
    return "\n".join(lines)


def _shown(fact: Any) -> str:
    if fact is None:
        return "unknown"
    if isinstance(fact, bool):
        return "yes" if fact else "no"
    if isinstance(fact, list):
        return ", ".join(map(_shown, fact))
    return f"{fact:.6g}" if isinstance(fact, float) else str(fact)


def revert_parser(program: str) -> ArgumentParser:
    """Make the parser of ``revert``."""
    parser = new_parser(program, "Put the recorded angles of a scan back.")
    parser.add_argument("scan", type=Path, metavar="SCAN", help="file that holds refined angles")
    return parser


def revert(args: Namespace) -> int:
    """Put the recorded angles back."""
    from tomoslam_stage import scans

    scans.revert(args.scan)
    print(f"{args.scan}: the recorded angles are back")
    return DONE
