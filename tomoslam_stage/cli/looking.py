"""Commands that look at a pipeline or a scan, and the one that puts angles back."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from pathlib import Path

from tomoslam_stage.cli.arguments import PIPELINE_HELP, PROGRAM, add_set, new_parser
from tomoslam_stage.cli.facts import table
from tomoslam_stage.errors import DONE, ScanError
from tomoslam_stage.stopping import Stopped

CHECK_EXAMPLES = f"""\
examples:
  {PROGRAM} check my.yaml
  {PROGRAM} check my.yaml scan.h5 --set refine_theta.width=1024
"""
INSPECT_EXAMPLES = f"""\
examples:
  {PROGRAM} inspect scan.h5
  {PROGRAM} inspect scan.nxs --json
"""
REVERT_EXAMPLES = f"""\
example:
  {PROGRAM} revert scan.h5
"""


def check_parser(program: str) -> ArgumentParser:
    """Make the parser of ``check``."""
    text = "Say what is wrong with a pipeline, and whether it fits a scan; nothing is done."
    parser = new_parser(program, text, CHECK_EXAMPLES)
    parser.add_argument("pipeline", metavar="PIPELINE", help=PIPELINE_HELP)
    parser.add_argument(
        "scan", type=Path, nargs="?", metavar="SCAN", help="DXchange or NXtomo file it should fit"
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
    text = "Say what is in a scan, and what is wrong with it (exit code 3)."
    parser = new_parser(program, text, INSPECT_EXAMPLES)
    parser.add_argument("scan", type=Path, metavar="SCAN", help="DXchange or NXtomo (HDF5) file")
    parser.add_argument("--json", action="store_true", help="the same facts for programs")
    return parser


def inspect(args: Namespace) -> int:
    """Print the facts of a scan."""
    from tomoslam_stage.scans import describe_scan

    facts = describe_scan(args.scan)
    print(json.dumps(facts, indent=2) if args.json else table(facts))
    return ScanError.exit_code if facts["problems"] else DONE


def revert_parser(program: str) -> ArgumentParser:
    """Make the parser of ``revert``."""
    parser = new_parser(program, "Put the recorded angles of a scan back.", REVERT_EXAMPLES)
    parser.add_argument("scan", type=Path, metavar="SCAN", help="file that holds refined angles")
    text = "write by way of a copy, however large the scan is"
    parser.add_argument("--safe-copy", action="store_true", help=text)
    return parser


def revert(args: Namespace) -> int:
    """Put the recorded angles back."""
    from tomoslam_stage import scans

    try:
        scans.revert(args.scan, safe_copy=args.safe_copy)
    except Stopped as stop:
        refined = scans.describe_scan(args.scan)["refined"]
        angles = "refined angles are still there" if refined else "recorded angles are back"
        stop.add_note(f"{args.scan.name}: the {angles}")
        raise
    print(f"{args.scan}: the recorded angles are back")
    return DONE
