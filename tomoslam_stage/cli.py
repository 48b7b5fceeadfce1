"""The command line: arguments in; files, a summary and an exit code out.

Nothing heavy is imported before it is needed, so that ``--help`` is instant.
"""

from __future__ import annotations

import json
import logging
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tomoslam_stage.console import logging_to, progress_shown
from tomoslam_stage.errors import BUG, DONE, KEPT, PipelineError, ScanError, StageError
from tomoslam_stage.progress import progress

if TYPE_CHECKING:
    from tomoslam_stage.simulation import SimulatedScan

log = logging.getLogger(__name__)

PROGRAM = "python -m tomoslam_stage"
BAD_ARGUMENT = PipelineError.exit_code
INTERRUPTED = 130

SHORTHANDS: Mapping[str, str] = {
    "bin": "load_scan.binning",
    "parallel": "load_scan.parallel",
    "axis": "refine_theta.axis",
    "rows": "reconstruct.rows",
    "save_slices": "compare.save_tiff",
}
"""Option -> the ``--set`` key it is short for."""

EPILOG = f"""\
other commands (as the first word; {PROGRAM} COMMAND --help tells more):
  inspect SCAN    say what is in a scan
  revert SCAN     put the recorded angles back
  simulate OUT    make a scan with known true angles

exit codes: 0 done; 2 pipeline or argument error; 3 unreadable or inconsistent scan;
4 the scan is sound but its recorded angles stand (the report is made all the same);
5 a chosen backend is not installed; 1 a bug
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Do what the command line says.

    Parameters
    ----------
    argv
        Its words without the program; those of this process by default.

    Returns
    -------
    The exit code.
    """
    words = sys.argv[1:] if argv is None else list(argv)
    command = words.pop(0) if words and words[0] in COMMANDS else ""
    make_parser, do = COMMANDS.get(command, (refine_parser, refine))
    args = make_parser(f"{PROGRAM} {command}".strip()).parse_args(words)
    try:
        with logging_to(args.log, args.verbose):
            return _answered(do, args)
    except OSError as error:  # of the log file: nothing has been done yet
        print(f"error: {_answer_to(error)[1]}", file=sys.stderr)
        return BAD_ARGUMENT


def _answered(do: Callable[[Namespace], int], args: Namespace) -> int:
    """Turn whatever goes wrong into one line and an exit code."""
    try:
        return do(args)
    except (Exception, KeyboardInterrupt) as error:
        code, line = _answer_to(error)
        log.error("%s", line)
        log.debug("where it happened", exc_info=True)
        return code


def _answer_to(error: BaseException) -> tuple[int, str]:
    if isinstance(error, StageError):
        return error.exit_code, " ".join(str(error).split())
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED, "interrupted"
    if isinstance(error, OSError):
        place = f"{error.filename}: " if error.filename else ""
        return BAD_ARGUMENT, f"{place}{error.strerror or error}"
    said = " ".join(f"{type(error).__name__}: {error}".split())
    return BUG, f"this is a bug: {said} (-v or --log FILE shows where)"


def refine_parser(program: str) -> ArgumentParser:
    """Make the parser of the main command."""
    parser = _parser(program, "Refine the rotation angles of a tomography scan.", EPILOG)
    parser.add_argument("--version", action="version", version=f"tomoslam_stage {_version()}")
    parser.add_argument("scan", type=Path, metavar="SCAN", help="DXchange (HDF5) file")
    parser.add_argument(
        "--pipeline",
        default="default",
        metavar="NAME|FILE",
        help="one that comes with the package (default, paper) or a YAML file",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--output", type=Path, metavar="FILE", help="write a companion file, leave the scan as is"
    )
    where.add_argument("--dry-run", action="store_true", help="refine and report, write no angles")
    parser.add_argument(
        "--report", type=Path, metavar="DIR", help="folder of the report (SCAN_tomoslam)"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change a parameter, as in refine_theta.steps_deg=[4,10]; may be repeated",
    )
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
    add("--rows", "slices: 10,50,100 or FROM:BEFORE:STEP", type=row_list, metavar="ROWS")
    add("--save-slices", "slices as TIFF too", action="store_true")


def inspect_parser(program: str) -> ArgumentParser:
    """Make the parser of ``inspect``."""
    parser = _parser(program, "Say what is in a scan, and what is wrong with it (exit code 3).")
    parser.add_argument("scan", type=Path, metavar="SCAN", help="DXchange (HDF5) file")
    return parser


def revert_parser(program: str) -> ArgumentParser:
    """Make the parser of ``revert``."""
    parser = _parser(program, "Put the recorded angles of a scan back.")
    parser.add_argument("scan", type=Path, metavar="SCAN", help="file that holds refined angles")
    return parser


def _parser(program: str, description: str, epilog: str = "") -> ArgumentParser:
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

    from tomoslam_stage.stages import STAGES, Work

    folder = args.report or args.scan.with_name(f"{args.scan.stem}_tomoslam")
    work = Work(path=args.scan, folder=folder, output=args.output, dry_run=args.dry_run)
    try:
        with progress_shown():
            run(entries, work, STAGES)
    finally:
        if work.report is not None:
            _print_summary(work.report, folder)
    kept = work.refinement is not None and work.refinement.status == "kept"
    return KEPT if kept else DONE


def _check_output(args: Namespace) -> None:
    if args.output is not None and args.output.resolve() == args.scan.resolve():
        raise PipelineError(
            "--output", f"{args.output} is the scan itself.", "Choose another file."
        )


def _print_summary(report: Mapping[str, Any], folder: Path) -> None:
    from tomoslam_stage.comparison import summary

    print(summary(report, folder))


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


def revert(args: Namespace) -> int:
    """Put the recorded angles back."""
    from tomoslam_stage import scans

    scans.revert(args.scan)
    print(f"{args.scan}: the recorded angles are back")
    return DONE


def simulate_parser(program: str) -> ArgumentParser:
    """Make the parser of ``simulate``."""
    parser = _parser(program, "Make a scan of a phantom with known true angles.")
    parser.add_argument("out", type=Path, metavar="OUT", help="DXchange (HDF5) file to make")
    parser.add_argument("--phantom", default="card", help="card, grains, foam or smooth")
    parser.add_argument("--projections", type=int, metavar="N", help="number of projections")
    parser.add_argument("--span", type=float, metavar="DEG", help="angle they are spread over")
    parser.add_argument("--rows", type=int, metavar="N", help="detector rows")
    parser.add_argument("--columns", type=int, metavar="N", help="detector columns")
    parser.add_argument(
        "--error",
        action="append",
        metavar="KIND:DEG",
        help="walk, jitter, lost_step or eccentric with its size, as in walk:0.05; "
        "repeated they add up; none for none",
    )
    parser.add_argument("--seed", type=int, metavar="N", help="of noise, dust and angle errors")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="anything else about the scan, as in roll_deg=0.1 or detector.dust=30",
    )
    return parser


RECIPE: Mapping[str, str] = {
    "phantom": "phantom",
    "projections": "n_projections",
    "span": "span_deg",
    "rows": "rows",
    "columns": "columns",
    "seed": "seed",
}
"""Option of ``simulate`` -> key of the recipe."""


def simulate(args: Namespace) -> int:
    """Make a scan whose true angles are known."""
    from tomoslam_stage import simulation

    spec = _recipe(args)
    if args.out.exists():
        raise PipelineError(str(args.out), "exists already.", "Choose another name or remove it.")
    scan = simulation.simulate(simulation.recipe_from(spec, "simulate"))
    with progress_shown():
        _write_scan(args.out, scan)
    print(f"{args.out}: {' x '.join(map(str, scan.shape))} (projections, rows, columns)")
    return DONE


def _recipe(args: Namespace) -> dict[str, Any]:
    from tomoslam_stage.entries import placed, read_setting

    given = {key: getattr(args, option) for option, key in RECIPE.items()}
    spec = {key: value for key, value in given.items() if value is not None}
    if args.error is not None:
        spec["angle_errors"] = [_angle_error(text) for text in args.error if text != "none"]
    for setting in args.set:
        keys, value = read_setting(setting)
        spec = placed(spec, keys, value, f"--set {setting}")
    return spec


def _angle_error(text: str) -> dict[str, Any]:
    """Read ``walk:0.05``; the size is the first parameter of each kind."""
    from tomoslam_stage.simulation import ANGLE_ERRORS

    kind, colon, size = text.partition(":")
    error: dict[str, Any] = {"method": kind}
    if colon and kind in ANGLE_ERRORS:
        error[fields(ANGLE_ERRORS[kind])[0].name] = size  # type: ignore[arg-type]
    return error


def _write_scan(path: Path, scan: SimulatedScan) -> None:
    import numpy as np

    from tomoslam_stage.scans import ScanContent, create_scan

    content = ScanContent(
        projections=progress(scan.projections(), "simulating", scan.shape[0]),
        flats=scan.whites,
        darks=scan.darks,
        theta_deg=np.degrees(scan.theta_recorded),
        true_theta_deg=np.degrees(scan.theta_true),
        true_axis_px=scan.axis,
        parameters=scan.recipe.described(),
    )
    create_scan(path, content)


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("tomoslam-stage")
    except PackageNotFoundError:
        return "(source checkout, not installed)"


COMMANDS: Mapping[str, tuple[Callable[[str], ArgumentParser], Callable[[Namespace], int]]] = {
    "inspect": (inspect_parser, inspect),
    "revert": (revert_parser, revert),
    "simulate": (simulate_parser, simulate),
}
"""First word -> the parser of the rest, and what is done. Any other first word is a scan."""
