"""The command that makes a scan with known true angles."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from tomoslam_stage.cli.arguments import PROGRAM, add_set, new_parser
from tomoslam_stage.console import progress_shown
from tomoslam_stage.errors import DONE, PipelineError
from tomoslam_stage.stopping import Stopped

EXAMPLES = f"""\
examples:
  {PROGRAM} simulate out.h5 --phantom grains --error walk:0.05
  {PROGRAM} simulate out.h5 --error lost_step:1.5 --error jitter:0.02 --seed 7
"""


def simulate_parser(program: str) -> ArgumentParser:
    """Make the parser of ``simulate``."""
    parser = new_parser(program, "Make a scan of a phantom with known true angles.", EXAMPLES)
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
    add_set(parser, "anything else about the scan, as in roll_deg=0.1 or detector.dust=30")
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
    from tomoslam_stage.scans import write_simulated

    spec = _recipe(args)
    if args.out.exists():
        raise PipelineError(str(args.out), "exists already.", "Choose another name or remove it.")
    scan = simulation.simulate(simulation.recipe_from(spec, "simulate"))
    try:
        with progress_shown():
            write_simulated(args.out, scan)
    except Stopped as stop:
        stop.add_note(f"{args.out} was {'made' if args.out.exists() else 'not made'}")
        raise
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
