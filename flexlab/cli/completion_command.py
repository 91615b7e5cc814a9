"""`flexlab completion`: let your shell complete commands and options."""

import importlib
import io
import os
from contextlib import redirect_stdout, suppress
from pathlib import Path
from typing import Annotated, Literal

import tyro

from flexlab.cli.console import note, output, tell
from flexlab.cli.options import option
from flexlab.errors import StudyError
from flexlab.files import writable

Shell = Literal["bash", "zsh", "fish"]

PLACES = {
    "bash": (".local/share/bash-completion/completions/flexlab", "It works in new shells that have bash-completion."),
    "zsh": (
        ".zfunc/_flexlab",
        "It works in new shells whose .zshrc has, once: fpath+=~/.zfunc; autoload -U compinit && compinit",
    ),
    "fish": (".config/fish/completions/flexlab.fish", "It works in new shells."),
}
"""Shell → (path of its script in the home folder, hint after installing it)."""


def command(
    shell: tyro.conf.Positional[
        Annotated[Shell | None, option("The shell; by default the one that $SHELL names.", "[bash|zsh|fish]")]
    ] = None,
    install: Annotated[bool, option("Write the script into your home folder, where the shell looks for it.")] = False,
) -> None:
    """Print or install the script with which a shell completes flexlab's commands and options."""
    chosen = shell or Path(os.environ.get("SHELL", "")).name
    if chosen not in PLACES:
        raise StudyError(f"The shell {chosen or 'that you use'} is not known: name bash, zsh or fish.")
    script = completion_script(chosen)
    if not install:
        output().out(script, end="")
        return
    place, then = PLACES[chosen]
    try:
        target = Path.home() / place
    except RuntimeError:  # In a container, for example.
        raise StudyError(
            "You have no home folder: set HOME, or leave out --install and put the script in its place."
        ) from None
    with writable(target, "choose another home folder"):
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(script, encoding="utf-8")
    tell(target)
    note(then)


def completion_script(shell: str) -> str:
    """The completion script of a shell, with every command and option."""
    from flexlab.cli import COMMANDS

    commands = {name: importlib.import_module(f"flexlab.cli.{name}_command").command for name in COMMANDS}
    printed, words = io.StringIO(), ["--tyro-print-completion", shell]
    with suppress(SystemExit), redirect_stdout(printed):
        config = (tyro.conf.FlagCreatePairsOff,)
        tyro.extras.subcommand_cli_from_dict(commands, prog="flexlab", args=words, config=config)
    return printed.getvalue()
