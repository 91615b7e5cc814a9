"""Control characters and markup in files, names and notes are shown by every command, and obeyed by no terminal."""

import io
import json
import logging
import re
import subprocess
import sys
from contextlib import redirect_stderr
from pathlib import Path

import numpy as np
import pytest
from lab_process import Command
from own_law_text import PD, forget_own_laws
from own_path_text import ROUND, forget_own_paths

import flexlab.cli
from flexlab.analysis.validation import Validation
from flexlab.analysis.validation.beam import closed_form
from flexlab.analysis.validation.check import Runs
from flexlab.cli import COMMANDS
from flexlab.own.law import add_own_law
from flexlab.presets import load_preset
from flexlab.recording.headless import write_run
from flexlab.sim.simulate import simulate
from flexlab.text import console, visible, visible_json

HOSTILE = "\x1b[2J\x1b[8m\x1b]0;owned\x07\x1b]8;;http://x\x1b\\\x9b31m\x85\x7f\x08\x0b\x0c\r\u202e\u2066\u200b\u200f\u2028\ufeff\U000e0041\u3164\u00ad\ufe01"
"""Erases the screen, conceals, renames the window, links, moves back, reverses the direction, hides."""
MARKUP = "[red]not red[/red] :bomb: [link=http://x]no link[/link]"
OBEYED = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\u3164\xad\ufe01\U000e0000-\U000e007f]"
)
NAME = "odd\x1b[31m\x9b8m\u202ename"
"""A name for files, without what a file system refuses."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs by a hostile law."""
    logs = tmp_path_factory.mktemp("hostile") / "logs"
    law = PD.replace("PD with weight", f"{HOSTILE} {MARKUP} PD with weight").replace(
        '"common force along x"', json.dumps(HOSTILE)
    )
    for name in ("one", NAME):
        chosen = load_preset("paper").replace({"controller.kind": add_own_law(law, f"{NAME}.py").kind})
        write_run(simulate(chosen, 0.5), logs, name)
    forget_own_laws()
    from flexlab.own import hosts

    hosts._allowed.clear()
    return logs


@pytest.fixture
def folder(recorded: Path, tmp_path: Path) -> Path:
    """A folder in which everything that somebody else may have written is hostile."""
    (tmp_path / "logs").symlink_to(recorded)
    (tmp_path / "presets").mkdir()
    (tmp_path / "presets" / "laws").mkdir()
    (tmp_path / "presets" / "paths").mkdir()
    data = load_preset("paper").model_dump(mode="json") | {"title": HOSTILE + MARKUP, "watch": HOSTILE + MARKUP}
    (tmp_path / "presets" / "hostile.json").write_text(json.dumps(data))
    (tmp_path / "presets" / f"{NAME}.json").write_text(json.dumps(data | {HOSTILE: HOSTILE}))
    fails = PD.replace("        e, e_dot", f"        raise ValueError({HOSTILE + MARKUP!r})\n        e, e_dot")
    (tmp_path / "fails.py").write_text(fails, encoding="utf-8")
    (tmp_path / "presets" / "laws" / f"{NAME}.py").write_text("class \x1b[8mA(OwnLaw):\n    k = gain('\x9b8m\u202e')\n")
    (tmp_path / "presets" / "paths" / "wrong.py").write_text(
        ROUND.replace("        turn =", f"        raise ValueError({HOSTILE + MARKUP!r})\n        turn =")
    )
    time = np.linspace(0, 1, 200)
    rows = "\n".join(f"{t},{y}" for t, y in zip(time, np.exp(-3 * time) * np.sin(90 * time), strict=True))
    for name, heading in (("odd.csv", f'"{HOSTILE}","{MARKUP}"'), ("fit.csv", f't [s],"{HOSTILE} [mm]"')):
        (tmp_path / name).write_text(f"{heading}\n{rows}\n", encoding="utf-8", newline="\n")
    for file in recorded.glob("*.rrd"):
        notes = {"note": HOSTILE + MARKUP, "tags": [HOSTILE, MARKUP], "preset": HOSTILE, "status": HOSTILE}
        file.with_suffix(".json").write_text(json.dumps(notes | {"changes": [HOSTILE + MARKUP], "problem": HOSTILE}))
    return tmp_path


CALLS: dict[str, list[tuple[str, ...]]] = {
    "lab": [("--preset", NAME), ("--law", f"{NAME}.py"), ("--path", "presets/paths/wrong.py"), ("--law", HOSTILE)],
    "run": [
        ("hostile", "--duration", "0.01"),
        ("hostile", "--duration", "0.01", "--law", "fails.py"),
        ("hostile", "--duration", "0.01", "--law", "fails.py", "--json"),
        ("hostile", "--path", "presets/paths/wrong.py"),
        ("hostile", "--law", f"presets/laws/{NAME}.py"),
        (NAME,),
        ("hostile", "--set", HOSTILE),
        ("hostile", "--set", f"{HOSTILE}={HOSTILE}"),
    ],
    "review": [(NAME,)],
    "logs": [(), ("--json",), ("one",), (HOSTILE,), ("--search", HOSTILE), ("--sort", HOSTILE)],
    "compare": [("{one}", "{odd}", "--save", f"{NAME}.rrd"), ("{one}", "{odd}", "--json"), ("{one}", HOSTILE)],
    "replay": [("{one}",), ("{odd}", "--run-own-law")],
    "export": [("{one}", "--to", f"{NAME}.csv"), ("{odd}", "--to", f"{NAME}.{NAME}")],
    "import": [("odd.csv",), (f"{NAME}.csv",), ("presets/hostile.json",)],
    "presets": [(), ("--json",), ("hostile",), (NAME,)],
    "sweep": [
        ("hostile", "--vary", HOSTILE),
        ("hostile", "--vary", f"{HOSTILE}=1:2:2"),
        (NAME, "--vary", "gravity=1,2"),
    ],
    "leaderboard": [("--law", f"presets/laws/{NAME}.py"), ("--law-name", HOSTILE), ("--case", HOSTILE)],
    "tune": [("hostile", "--change", HOSTILE), ("hostile", "--change", "gravity=1:2", "--cost", HOSTILE)],
    "fit": [
        ("fit.csv", "--time", "t [s]", "--signal", HOSTILE),
        ("odd.csv", "--time", HOSTILE),
        ("{one}", "--signal", HOSTILE),
    ],
    "validate": [("--to", f"{NAME}/{NAME}.html")],
    "bench": [(HOSTILE,)],
    "completion": [(HOSTILE,)],
}
"""Arguments with which each command is called; one that is not listed gets `HOSTILE`. {one} and {odd}: the two runs."""


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_shows_a_control_character(
    command: str, folder: Path, flexlab_command: Command, monkeypatch: pytest.MonkeyPatch
):
    few = Validation({"The beam in closed form": tuple(closed_form(Runs()))}, Runs())
    monkeypatch.setattr(
        "flexlab.analysis.validation.validate", lambda: few
    )  # All checks take seconds, and show nothing that others wrote.
    one, odd = (next((folder / "logs").glob(f"*{name}*.rrd")).stem for name in ("one", "odd"))
    for words in CALLS.get(command, [(HOSTILE,)]):
        done = flexlab_command(command, *(word.replace("{one}", one).replace("{odd}", odd) for word in words))
        text = done.stdout + done.stderr
        assert text, words
        assert OBEYED.findall(text) == [], (words, text)
        assert "💣" not in text
        assert "Traceback" not in text
    forget_own_laws()
    forget_own_paths()


def test_json_keeps_its_data_and_a_title_keeps_its_brackets(folder: Path, flexlab_command: Command):
    assert HOSTILE in "".join(json.loads(visible_json(json.dumps([HOSTILE], ensure_ascii=False))))
    listed = flexlab_command("presets").stdout.replace("\n", " ")
    assert re.sub(r"\s+", " ", MARKUP) in re.sub(r"\s+", " ", listed)
    assert json.loads(flexlab_command("logs", "--json").stdout)


def test_a_law_is_shown_whole_before_it_may_run(folder: Path, flexlab_command: Command):
    (run,) = (folder / "logs").glob("*one*.rrd")
    shown = flexlab_command("replay", run.stem).stderr
    assert visible(HOSTILE).replace("\n", "") in shown.replace("\n", "")
    assert "Let it run here?" in shown


def test_a_terminal_gets_the_styles_of_flexlab_and_no_others(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    from rich.table import Table
    from rich.text import Text

    said = io.StringIO()
    with redirect_stderr(said):
        terminal = console(stderr=True)
        table = Table(HOSTILE + MARKUP, title=HOSTILE + MARKUP)
        table.add_row(HOSTILE + MARKUP)
        table.add_row(Text(HOSTILE + MARKUP))
        terminal.print(table, HOSTILE + MARKUP, Text(HOSTILE), style="bold red")
        terminal.out(HOSTILE)
    without_styles = re.sub(r"\x1b\[[\d;]*m", "", said.getvalue())
    assert OBEYED.findall(without_styles) == []
    assert "\x1b[8m" not in said.getvalue()
    assert without_styles.count("not red[/red]") >= 3


def test_control_characters_in_logs_are_not_obeyed():
    assert logging.lastResort is not None
    with pytest.raises(SystemExit):
        flexlab.cli.main(["--version"])
    record = logging.LogRecord("a", logging.WARNING, "", 0, "%s", (HOSTILE,), None)
    assert OBEYED.findall(logging.lastResort.format(record)) == []


FAILS = """
import sys, threading, asyncio
import flexlab.cli
from flexlab.server.tasks import Tasks
from flexlab.server.limits import THE_SERVER

def fail(text):
    raise ValueError(text)

if __name__ == "__main__":
    try:
        flexlab.cli.main(["--version"])
    except SystemExit:
        pass
    thread = threading.Thread(target=fail, args=(TEXT,))
    thread.start()
    thread.join()
    try:
        asyncio.run(Tasks().run(THE_SERVER, fail, TEXT))
    finally:
        fail(TEXT)
"""
"""A program in which flexlab fails on what others wrote: in a thread, a task and the main program."""


def test_control_characters_in_tracebacks_are_not_obeyed(tmp_path: Path):
    script = tmp_path / "fails.py"
    script.write_text(FAILS.replace("TEXT", repr(HOSTILE)))
    told = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False).stderr
    assert told.count("\nValueError: ") == 3, "of the thread, the task and the main program"
    assert OBEYED.findall(told) == []


def test_all_commands_with_arguments_listed_here_exist():
    assert CALLS.keys() <= set(COMMANDS)
