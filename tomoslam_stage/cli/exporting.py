"""The command that writes the angles for other programs."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from tomoslam_stage.cli.arguments import PROGRAM, new_parser
from tomoslam_stage.errors import DONE

EXAMPLES = f"""\
examples:
  {PROGRAM} export scan.h5 --format nabu
  {PROGRAM} export scan.nxs --format httomo --output pipeline.yaml
"""


def export_parser(program: str) -> ArgumentParser:
    """Make the parser of ``export``."""
    text = "Write the angles that stand in a scan, or in a companion, for another program."
    parser = new_parser(program, text, EXAMPLES)
    parser.add_argument("scan", type=Path, metavar="SCAN", help="DXchange or NXtomo (HDF5) file")
    parser.add_argument(
        "--format", required=True, metavar="NAME", help="httomo, nabu, imod or text"
    )
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="file to write (SCAN_NAME beside the scan)"
    )
    return parser


def export(args: Namespace) -> int:
    """Write the files, and say what to do with them."""
    from tomoslam_stage import exports

    for path, use in exports.export(args.scan, args.format, args.output).items():
        print(f"{path}: {use}")
    return DONE
