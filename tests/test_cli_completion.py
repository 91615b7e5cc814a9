"""`flexlab completion` prints and installs scripts with which shells complete the commands."""

import os
import pwd
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import pytest

from flexlab.cli import COMMANDS, main

BASH = shutil.which("bash")


def test_bash_completes_commands_and_options_once_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SHELL", "/bin/bash")
    with pytest.raises(SystemExit) as ended:
        main(["completion", "--install"])
    assert ended.value.code == 0
    file = tmp_path / ".local/share/bash-completion/completions/flexlab"
    assert capsys.readouterr().out.strip() == str(file)
    assert BASH, "bash is needed to see whether it takes the script"
    for words, offered in ((("com",), "completion"), (("run", "--see"), "--seed"), (("run", "--l"), "--law")):
        line = " ".join(("flexlab", *words))
        program = (
            f'source "{file}"; COMP_WORDS=({line}); COMP_CWORD={len(words)}; COMP_LINE="{line}"; COMP_POINT={len(line)}; '
            '"$(complete -p flexlab | sed "s/.*-F \\([^ ]*\\).*/\\1/")"; echo "${COMPREPLY[@]}"'
        )
        done = subprocess.run([BASH, "-c", program], capture_output=True, text=True, check=True, env=os.environ)
        assert offered in done.stdout.split(), done


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_shell_has_a_script(shell: str, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit):
        main(["completion", shell])
    printed = capsys.readouterr().out
    assert "--sample-period" in printed
    assert "flexlab" in printed


def test_an_unknown_shell_is_one_sentence(flexlab_command: Callable, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SHELL", "/bin/tcsh")
    done = flexlab_command("completion")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "The shell tcsh is not known: name bash, zsh or fish.\n"


def test_a_user_without_a_home_is_told_so(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """A container's user may have neither home nor name: `completion --install` ended in a traceback."""

    def unknown(number: int) -> NoReturn:
        raise KeyError(number)

    monkeypatch.delenv("HOME")
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    with pytest.raises(SystemExit) as ended:
        main(["completion", "bash", "--install"])
    assert ended.value.code == 2
    assert capsys.readouterr().err == (
        "You have no home folder: set HOME, or leave out --install and put the script in its place.\n"
    )


@pytest.mark.parametrize("command", COMMANDS)
def test_help_does_not_show_the_none_of_python(command: str, capsys: pytest.CaptureFixture[str]):
    """`--part {None,plant,…}` and "(default: None)" said what Python holds, not what to write."""
    with pytest.raises(SystemExit):
        main([*([] if command == "lab" else [command]), "--help"])
    assert "None" not in capsys.readouterr().out
