"""The command line: arguments in; files, a summary and an exit code out.

Nothing heavy is imported before it is needed, so that ``--help`` is instant.
"""

from __future__ import annotations

import logging
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Mapping, Sequence

from tomoslam_stage.cli.arguments import PROGRAM
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
from tomoslam_stage.console import logging_to
from tomoslam_stage.errors import BUG, PipelineError, StageError

log = logging.getLogger(__name__)

BAD_ARGUMENT = PipelineError.exit_code
INTERRUPTED = 130


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


COMMANDS: Mapping[str, tuple[Callable[[str], ArgumentParser], Callable[[Namespace], int]]] = {
    "check": (check_parser, check),
    "inspect": (inspect_parser, inspect),
    "revert": (revert_parser, revert),
    "simulate": (simulate_parser, simulate),
}
"""First word -> the parser of the rest, and what is done. Any other first word is a scan."""
