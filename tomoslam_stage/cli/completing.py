"""The command that prints what makes a shell complete our words, read off the parsers."""

from __future__ import annotations

from argparse import Action, ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from tomoslam_stage.cli.arguments import PROGRAM, new_parser
from tomoslam_stage.errors import DONE, PipelineError, nearest

SCRIPT = "tomoslam-stage"
"""What is completed: a module that python runs has no name of its own to a shell."""
VALUES: Mapping[str, tuple[str, ...]] = {
    "--pipeline": ("default", "fast", "paper", "sirt", "stripes"),
    "--format": ("httomo", "imod", "nabu", "text"),
    "--phantom": ("card", "foam", "grains", "smooth"),
}
"""Option -> words it takes; others take file names."""
WORDS: Mapping[str, tuple[str, ...]] = {
    "check": VALUES["--pipeline"],
    "completion": ("bash", "fish", "zsh"),
    "describe": ("compare", "load_scan", "reconstruct", "refine_theta", "write_theta"),
    "study": ("all", "error-ratio", "histograms", "sd-card", "step-size", "timing"),
}
"""Command -> its first words; others take file names."""

EXAMPLES = f"""\
examples:
  {PROGRAM} completion bash >> ~/.bashrc
  {PROGRAM} completion zsh > ~/.zfunc/_{SCRIPT}     (a folder in $fpath)
  {PROGRAM} completion fish > ~/.config/fish/completions/{SCRIPT}.fish
What is completed are the words behind {SCRIPT}, which the installation brings.
"""

Parsers = Mapping[str, ArgumentParser]
"""By command, that of the scan under no name."""


@dataclass(frozen=True)
class Option:
    """An option as a shell completes it."""

    name: str
    takes: bool
    """Whether a value follows."""
    text: str


def options(parser: ArgumentParser) -> Iterator[Option]:
    """Yield the options of a parser, in the order of its help."""
    actions: Sequence[Action] = parser._actions  # argparse has no public list of them
    for action in actions:
        text = (action.help or "").partition(";")[0].replace("%%", "%")
        for name in action.option_strings:
            yield Option(name, action.nargs != 0, text)


def bash(parsers: Parsers) -> str:
    """Write a completion for bash; what it knows nothing of, readline completes as ever."""
    cases = "\n".join(
        f'    {command or "*"}) options="{" ".join(o.name for o in options(parser))}"'
        f' words="{" ".join(WORDS.get(command, ()))}" ;;'
        for command, parser in _last_without_name(parsers)
    )
    values = "\n".join(
        f'    {option}) words="{" ".join(words)}" ;;' for option, words in VALUES.items()
    )
    return f"""\
_tomoslam_stage() {{
  local current=${{COMP_WORDS[COMP_CWORD]}} options words
  case "${{COMP_WORDS[1]}}" in
{cases}
  esac
  if ((COMP_CWORD == 1)); then words="{" ".join(filter(None, parsers))}"; fi
  case "${{COMP_WORDS[COMP_CWORD-1]}}" in
{values}
  esac
  if [[ $current == -* ]]; then COMPREPLY=($(compgen -W "$options" -- "$current")); return; fi
  COMPREPLY=($(compgen -W "$words" -- "$current"))
  local IFS=$'\\n'
  COMPREPLY+=($(compgen -f -- "$current"))
}}
complete -o filenames -o default -F _tomoslam_stage {SCRIPT}
"""


def zsh(parsers: Parsers) -> str:
    """Write a completion for zsh."""

    def offer(words: Sequence[str]) -> str:
        # Behind a space the words of an action stay as they are; else zsh puts options among them.
        return f" _tomoslam_stage_offer {' '.join(words)}" if words else "_files"

    def spec(option: Option) -> str:
        text = option.text.replace("[", "(").replace("]", ")").replace("'", "").replace(":", "\\:")
        value = f":value:{offer(VALUES.get(option.name, ()))}" if option.takes else ""
        return f"'*{option.name}[{text}]{value}'"

    cases = "\n".join(
        f"    {command or '*'}) _arguments {' '.join(map(spec, options(parser)))}"
        f" '*:word:{offer(WORDS.get(command, ()))}' ;;"
        for command, parser in _last_without_name(parsers)
    )
    return f"""\
#compdef {SCRIPT}
_tomoslam_stage_offer() {{ _alternative "word:word:($*)" "file:file:_files" }}
_tomoslam_stage() {{
  if ((CURRENT == 2)) && [[ $PREFIX != -* ]]; then
    _tomoslam_stage_offer {" ".join(filter(None, parsers))}
    return
  fi
  case "${{words[2]}}" in
{cases}
  esac
}}
if [[ $funcstack[1] == _{SCRIPT} ]]; then _tomoslam_stage "$@"
else compdef _tomoslam_stage {SCRIPT}; fi
"""


def fish(parsers: Parsers) -> str:
    """Write a completion for fish."""
    names = " ".join(filter(None, parsers))
    lines = [f"complete -c {SCRIPT} -n __fish_use_subcommand -a '{names}'"]
    for command, parser in parsers.items():
        here = f"__fish_seen_subcommand_from {command or names}"
        here = f"-n '{here if command else f'not {here}'}'"
        if command in WORDS:
            lines.append(f"complete -c {SCRIPT} {here} -a '{' '.join(WORDS[command])}'")
        for option in options(parser):
            kind = "-l" if option.name.startswith("--") else "-s"
            words = f" -a '{' '.join(VALUES[option.name])}'" if option.name in VALUES else ""
            said = option.text.replace("'", "")
            lines.append(
                f"complete -c {SCRIPT} {here} {kind} {option.name.lstrip('-')}"
                f"{' -r' if option.takes else ''}{words} -d '{said}'"
            )
    return "\n".join(lines) + "\n"


SHELLS: Mapping[str, Callable[[Parsers], str]] = {"bash": bash, "fish": fish, "zsh": zsh}


def _last_without_name(parsers: Parsers) -> list[tuple[str, ArgumentParser]]:
    """Put the parser of the scan, which any other first word means, behind all others."""
    return sorted(parsers.items(), key=lambda item: item[0] == "")


def completion_parser(program: str) -> ArgumentParser:
    """Make the parser of ``completion``."""
    text = "Print what makes a shell complete commands, options and names."
    parser = new_parser(program, text, EXAMPLES)
    parser.add_argument("shell", metavar="SHELL", help="bash, zsh or fish")
    return parser


def completion(args: Namespace) -> int:
    """Print the completion of a shell."""
    from tomoslam_stage.cli import parsers

    if args.shell not in SHELLS:
        found = f"no completion for {args.shell!r}."
        raise PipelineError("completion", found, nearest(args.shell, SHELLS))
    print(SHELLS[args.shell](parsers()), end="")
    return DONE
