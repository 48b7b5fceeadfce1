"""The main command: run a pipeline on a scan."""

from __future__ import annotations

import json
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from os.path import realpath
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tomoslam_stage.cli.arguments import PIPELINE_HELP, PROGRAM, add_set, new_parser, row_list
from tomoslam_stage.console import progress_shown, speaks_unicode
from tomoslam_stage.errors import DONE, KEPT, PipelineError
from tomoslam_stage.stopping import Stopped

if TYPE_CHECKING:
    from tomoslam_stage.stages import Work

SHORTHANDS: Mapping[str, str] = {
    "bin": "load_scan.binning",
    "parallel": "load_scan.parallel",
    "cache": "refine_theta.tracks.cache",
    "drop_frames": "load_scan.drop_frames",
    "keep_frames": "load_scan.keep_frames",
    "drop_angles": "load_scan.drop_angles",
    "axis": "refine_theta.axis",
    "rows": "reconstruct.rows",
    "save_slices": "compare.save_tiff",
    "safe_copy": "write_theta.safe_copy",
}
"""Option -> the ``--set`` key it is short for."""

EPILOG = f"""\
examples:
  {PROGRAM} scan.h5                             refine, report, write if accepted
  {PROGRAM} scan.nxs --output refined.nxs       leave the scan alone
  {PROGRAM} scan.h5 --dry-run --pipeline fast   look first
  {PROGRAM} scan.h5 --axis 1023.5 --bin 2 --rows 400,1000
  {PROGRAM} scan.h5 --set refine_theta.mapping.rows=64

other commands (as the first word; {PROGRAM} COMMAND --help tells more):
  check PIPELINE [SCAN]  say what is wrong with a pipeline before any work
  inspect SCAN           say what is in a scan
  describe [ENTRY]       tell every option of a pipeline, its default, range and meaning
  export SCAN            write the angles for HTTomo, nabu or IMOD
  revert SCAN            put the recorded angles back
  simulate OUT           make a scan with known true angles
  study NAME [SCAN]      re-run a published experiment
  completion SHELL       let bash, zsh or fish complete all of this

exit codes: 0 done; 2 pipeline or argument error; 3 unreadable or inconsistent scan;
4 the scan is sound but its recorded angles stand (the report is made all the same);
5 a chosen backend is not installed; 1 a bug
"""


def refine_parser(program: str) -> ArgumentParser:
    """Make the parser of the main command."""
    parser = new_parser(program, "Refine the rotation angles of a tomography scan.", EPILOG)
    parser.add_argument("--version", action="version", version=f"tomoslam_stage {_version()}")
    parser.add_argument("scan", type=Path, metavar="SCAN", help="DXchange or NXtomo (HDF5) file")
    parser.add_argument(
        "--pipeline",
        default="default",
        metavar="NAME|FILE",
        help=PIPELINE_HELP,
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--output", type=Path, metavar="FILE", help="write a companion file, leave the scan as is"
    )
    where.add_argument("--dry-run", action="store_true", help="refine and report, write no angles")
    parser.add_argument(
        "--report", type=Path, metavar="DIR", help="folder of the report (SCAN_tomoslam)"
    )
    add_set(parser, "change a parameter, as in refine_theta.width=320; may be repeated")
    _add_shorthands(parser)
    return parser


def _add_shorthands(parser: ArgumentParser) -> None:
    group = parser.add_argument_group("in short for --set")

    def add(option: str, text: str, **how: Any) -> None:
        key = SHORTHANDS[option.removeprefix("--").replace("-", "_")]
        group.add_argument(option, help=f"{text} ({key})", **how)

    add("--bin", "bin N x N detector pixels", type=int, metavar="N")
    add("--axis", "column of the rotation axis, px", type=float, metavar="PX")
    add("--parallel", "treat the beam as parallel, whatever the file says", action="store_true")
    add("--cache", "keep keypoints in a folder; a rerun goes on from them", metavar="DIR")
    add("--drop-frames", "frames to leave out, as in 12,40:43", metavar="FRAMES")
    add("--keep-frames", "the only frames to use; : for all, however they look", metavar="FRAMES")
    add("--drop-angles", "entries of theta that have no frame", metavar="ANGLES")
    add("--rows", "slices: 10,50,100 or FROM:BEFORE:STEP", type=row_list, metavar="ROWS")
    add("--save-slices", "slices as TIFF too", action="store_true")
    add("--safe-copy", "write by way of a copy, however large the scan is", action="store_true")


def settings(args: Namespace) -> list[str]:
    """Give all parameters the command line changes as ``KEY=VALUE``, those of ``--set`` last."""
    given = {key: getattr(args, option) for option, key in SHORTHANDS.items()}
    short = [f"{k}={json.dumps(v)}" for k, v in given.items() if v is not None and v is not False]
    return [*short, *args.set]


def refine(args: Namespace) -> int:
    """Run a pipeline on a scan and say how it went."""
    from tomoslam_stage.pipeline import apply_settings, load_pipeline, run

    entries = apply_settings(load_pipeline(args.pipeline), settings(args))
    _check_output(args)

    from tomoslam_stage.stages import MODULES, Work

    folder = args.report or args.scan.with_name(f"{args.scan.stem}_tomoslam")
    work = Work(path=args.scan, folder=folder, output=args.output, dry_run=args.dry_run)
    try:
        with progress_shown():
            run(entries, work, MODULES)
    except Stopped as stop:
        stop.add_note(_done_until_then(work))
        raise
    finally:
        if work.report is not None:
            _print_summary(work.report, folder)
    kept = work.refinement is not None and work.refinement.status == "kept"
    return KEPT if kept else DONE


def _check_output(args: Namespace) -> None:
    if args.output is not None and realpath(args.output) == realpath(args.scan):
        raise PipelineError(
            "--output", f"{args.output} is the scan itself.", "Choose another file."
        )


def _done_until_then(work: Work) -> str:
    """Say what a run that was stopped has done; what it wrote is whole."""
    from tomoslam_stage.scans import is_written

    target = work.output or work.path
    written = is_written(target, work.started)
    wrote = f"{target.name} holds the refined angles" if written else "no angles were written"
    reported = "incomplete" if work.report is None else f"in {work.folder.name}"
    return f"{wrote}, the report is {reported}"


def _print_summary(report: Mapping[str, Any], folder: Path) -> None:
    from tomoslam_stage.comparison import summary

    print(summary(report, folder, unicode=speaks_unicode(sys.stdout)))


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("tomoslam-stage")
    except PackageNotFoundError:
        return "(source checkout, not installed)"
