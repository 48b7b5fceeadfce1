"""The command line: arguments in; files, a summary and an exit code out.

Nothing heavy is imported before it is needed, so that ``--help`` is instant.
"""

from __future__ import annotations

import logging
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Mapping, Sequence

from tomoslam_stage.cli.arguments import PROGRAM, one_line
from tomoslam_stage.cli.completing import completion, completion_parser
from tomoslam_stage.cli.describing import describe, describe_parser
from tomoslam_stage.cli.exporting import export, export_parser
from tomoslam_stage.cli.looking import (
    check,
    check_parser,
    inspect,
    inspect_parser,
    revert,
    revert_parser,
)
from tomoslam_stage.cli.refining import refine, refine_parser
from tomoslam_stage.cli.simulating import simulate, simulate_parser
from tomoslam_stage.cli.studying import study, study_parser
from tomoslam_stage.console import logging_to
from tomoslam_stage.errors import BUG, PipelineError, StageError
from tomoslam_stage.stopping import Stopped, stoppable

log = logging.getLogger(__name__)

BAD_ARGUMENT = PipelineError.exit_code


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
        with stoppable(), logging_to(args.log, args.verbose):
            return _answered(do, args)
    except OSError as error:  # of the log file: nothing has been done yet
        print(f"error: {_answer_to(error)[1]}", file=sys.stderr)
        return BAD_ARGUMENT


def _answered(do: Callable[[Namespace], int], args: Namespace) -> int:
    """Turn whatever goes wrong into one line and an exit code."""
    try:
        return do(args)
    except (Exception, Stopped) as error:
        code, line = _answer_to(error)
        log.error("%s", line)
        log.debug("where it happened", exc_info=True)
        return code


def _answer_to(error: BaseException) -> tuple[int, str]:
    if isinstance(error, StageError):
        return error.exit_code, one_line(str(error))
    if isinstance(error, Stopped):
        done = getattr(error, "__notes__", ["nothing was written"])
        return error.exit_code, "; ".join([str(error), *done])
    if isinstance(error, MemoryError):
        return BUG, one_line(f"this machine has too little memory: {error}")
    if isinstance(error, OSError):
        place = f"{error.filename}: " if error.filename else ""
        return BAD_ARGUMENT, one_line(f"{place}{error.strerror or error}")
    said = one_line(f"{type(error).__name__}: {error}")
    return BUG, f"this is a bug: {said} (-v or --log FILE shows where)"


COMMANDS: Mapping[str, tuple[Callable[[str], ArgumentParser], Callable[[Namespace], int]]] = {
    "check": (check_parser, check),
    "completion": (completion_parser, completion),
    "describe": (describe_parser, describe),
    "export": (export_parser, export),
    "inspect": (inspect_parser, inspect),
    "revert": (revert_parser, revert),
    "simulate": (simulate_parser, simulate),
    "study": (study_parser, study),
}
"""First word -> the parser of the rest, and what is done. Any other first word is a scan."""


def parsers() -> Mapping[str, ArgumentParser]:
    """Make the parser of each command, that of the scan under no name."""
    made = {name: make(f"{PROGRAM} {name}") for name, (make, _) in COMMANDS.items()}
    return {**made, "": refine_parser(PROGRAM)}
