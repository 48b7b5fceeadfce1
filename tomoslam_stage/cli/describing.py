"""The command that tells what an entry of a pipeline may say."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace

from tomoslam_stage.cli.arguments import PROGRAM, new_parser
from tomoslam_stage.errors import DONE

EXAMPLES = f"""\
examples:
  {PROGRAM} describe
  {PROGRAM} describe refine_theta
  {PROGRAM} describe refine_theta.tracks.detector
  {PROGRAM} describe --json-schema > pipeline.schema.json
      and, as the first line of the YAML, for editors with the YAML language server:
      # yaml-language-server: $schema=pipeline.schema.json
"""


def describe_parser(program: str) -> ArgumentParser:
    """Make the parser of ``describe``."""
    text = "Describe the options of a pipeline's entries: type, default, range and meaning."
    parser = new_parser(program, text, EXAMPLES)
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "entry", nargs="?", metavar="ENTRY[.OPTION]", help="an entry, a section or an option"
    )
    text = "print a schema by which editors complete and check pipelines"
    what.add_argument("--json-schema", action="store_true", help=text)
    return parser


def describe(args: Namespace) -> int:
    """Print the description."""
    from tomoslam_stage import describing

    if args.json_schema:
        print(json.dumps(describing.schema(), indent=1))
    else:
        print(describing.described(args.entry) if args.entry else describing.overview())
    return DONE
