"""The command that re-runs the published experiments."""

from __future__ import annotations

import logging
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tomoslam_stage.cli.arguments import PROGRAM, add_set, new_parser
from tomoslam_stage.console import progress_shown
from tomoslam_stage.errors import DONE, PipelineError, nearest

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tomoslam_stage.studies import Case, Study

log = logging.getLogger(__name__)

ALL, CASE = "all", "case"


EXAMPLES = f"""\
examples:
  {PROGRAM} study all --fast
  {PROGRAM} study step-size scan.h5
"""


def study_parser(program: str) -> ArgumentParser:
    """Make the parser of ``study``."""
    text = "Re-run the published experiments, on a scan or on the paper's case, simulated."
    parser = new_parser(program, text, EXAMPLES)
    parser.add_argument(
        "name", metavar="NAME", help="step-size, histograms, error-ratio, timing, sd-card or all"
    )
    parser.add_argument(
        "scan", type=Path, nargs="?", metavar="SCAN", help="DXchange (HDF5) file; simulated if none"
    )
    parser.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help="folder of the results (SCAN_studies, or case_studies here)",
    )
    parser.add_argument("--fast", action="store_true", help="small and quick, to see that it runs")
    add_set(
        parser,
        "change a parameter of the study, as in draws=100 (of all: error-ratio.draws=100), or of "
        "what is simulated, as in case.rows=512; may be repeated",
    )
    return parser


def study(args: Namespace) -> int:
    """Run one study, or all of them and the page about them."""
    from tomoslam_stage.comparison.writing import made_folder
    from tomoslam_stage.studies import write_outcome, write_page

    changes = settings(args)
    studies = chosen(args, changes)
    default = Path("case_studies")
    if args.scan is not None:
        default = args.scan.with_name(f"{args.scan.stem}_studies")
    folder = made_folder(args.output or default, "--output")
    outcomes = {}
    with progress_shown():
        case = case_of(args, folder, changes.get(CASE, {}))
        log.info("%s", case.origin)
        for name, each in studies.items():
            outcomes[name] = each.run(case)
            write_outcome(folder, name, each, case, outcomes[name])
            log.info("%s is done", name)
        if args.name == ALL:
            write_page(folder, case, outcomes)
    print(case.origin)
    for name, outcome in outcomes.items():
        print(f"{name}: {outcome.conclusion}")
    print(f"results: {folder}: {'index.html, table.md; ' if args.name == ALL else ''}", end="")
    print(", ".join(f"{name}.png, .csv, .json" for name in outcomes))
    return DONE


def settings(args: Namespace) -> dict[str, Any]:
    """Read ``--set`` as parameters by study, those of the case under ``case``.

    Raises
    ------
    PipelineError
        For what is no setting, and for a study that is not run.
    """
    from tomoslam_stage.entries import placed, read_setting
    from tomoslam_stage.studies import STUDIES

    changes: dict[str, Any] = {}
    known = [CASE, *(STUDIES if args.name == ALL else [args.name])]
    for setting in args.set:
        where = f"--set {setting}"
        keys, value = read_setting(setting)
        if args.name != ALL and keys[0] not in known:
            keys = [args.name, *keys]
        if keys[0] not in known or len(keys) < 2:
            example = "STUDY.PARAMETER=VALUE is needed, as in error-ratio.draws=100."
            raise PipelineError(
                where, f"no parameter of a study; {example}", nearest(keys[0], known)
            )
        changes = placed(changes, keys, value, where)
    return changes


def chosen(args: Namespace, changes: Mapping[str, Any]) -> dict[str, Study]:
    """Make the studies that are asked for, their parameters checked.

    Raises
    ------
    PipelineError
        For an unknown study or parameter, or a value that does not fit.
    """
    from tomoslam_stage.methods import checked
    from tomoslam_stage.studies import STUDIES

    if args.name != ALL and args.name not in STUDIES:
        remedy = nearest(args.name, [*STUDIES, ALL])
        raise PipelineError("study", f"no study {args.name!r}.", remedy)
    names = list(STUDIES) if args.name == ALL else [args.name]
    return {
        name: checked(
            STUDIES[name],
            {**(STUDIES[name].fast if args.fast else {}), **changes.get(name, {})},
            f"study.{name}",
        )
        for name in names
    }


def case_of(args: Namespace, folder: Path, changes: Mapping[str, Any]) -> Case:
    """Return the scan that is given, or simulate one.

    Raises
    ------
    StageError
        For a scan that cannot be used, and a recipe that does not fit.
    """
    from tomoslam_stage.studies import given, simulated
    from tomoslam_stage.studies.case import FAST

    if args.scan is None:
        return simulated(folder, {**(FAST if args.fast else {}), **changes})
    if changes:
        found = f"case.{next(iter(changes))} is for what is simulated; {args.scan.name} is a scan."
        raise PipelineError("--set", found, "Leave it out, or leave out the scan.")
    return given(args.scan, folder)
