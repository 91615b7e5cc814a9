"""Every command and snippet in README, CONTRIBUTING and the documentation runs, in the order of the text.

Snippets and a few commands are always tried; all commands, which take minutes, with `pytest tests/test_documented.py
--documented`. The commands that set up and check a checkout are tried by `.ci/run`.
"""

import contextlib
import functools
import math
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import wait_until

import flexlab
from flexlab.cli import main
from flexlab.recording.headless import HeadlessRecording
from flexlab.recording.run_info import RunInfo
from flexlab.sim.commands import Tap
from flexlab.sim.snapshot import Event

PAGES = "web_assets/docs/pages/"
DOCUMENTS = (
    "README.md",
    *(f"{PAGES}{page}.md" for page in ("scripts", "own", "studies", "class", "runs")),
    ".github/CONTRIBUTING.md",
)
CODE = re.compile(r"^```(?P<kind>\w*)\n(?P<block>.*?)^```|`(?P<words>[^`]+)`", re.DOTALL | re.MULTILINE)
COMMAND = re.compile(r"flexlab( |\Z)|(pytest|ruff|pyright|python\S*|pip|pre-commit|apt|dask) ")
SNIPPET = re.compile(r"(?!flexlab/).*(\w\(|\bimport )", re.DOTALL)
OF_THE_CHECKOUT = {
    "python3.11 -m venv .venv && .venv/bin/pip install -c constraints.txt . && .venv/bin/flexlab",
    'python3.11 -m venv .venv && .venv/bin/pip install -c constraints.txt -e ".[test]" && '
    ".venv/bin/python tests/get_browser.py && .venv/bin/pytest",
    "python -m venv .venv && . .venv/bin/activate",
    'pip install --constraint constraints.txt --editable ".[test]"',
    "ruff check .", "ruff format .", "pyright --level error", "pytest tests/physics",
}  # fmt: skip
"""Commands that `.ci/run` does, step by step."""
ELSEWHERE = {
    "pytest tests/lab/test_lessons_in_browser.py --all-lessons": "two of the lessons are done each time",
    "python tests/analysis/planted_errors.py": "tests/analysis/test_validation.py plants one of them",
    "python tests/test_public_members.py": "tests/test_public_members.py says so where it is due",
    "python tests/scenario/test_recorded_ranges.py": "so does tests/scenario/test_recorded_ranges.py",
    "python web_assets/make/leaderboard.py": "tests/analysis/test_leaderboard.py",
    "python web_assets/make/pictures.py": "tests/test_guide.py",
    "apt install python3.11-venv": "of the machine",
    "pre-commit install": "of another program",
    'pip install "flexlab[control]"': "tests/test_dependencies.py",
    'pip install "flexlab[mpc]"': "tests/test_dependencies.py",
    'pip install "flexlab[cluster]"': "tests/test_dependencies.py",
    'pip install "flexlab[gym]"': "tests/test_dependencies.py",
    'pip install "flexlab[xarray]"': "tests/test_dependencies.py",
    'pip install "flexlab[jupyter]"': "tests/server/test_base_url.py",
    "flexlab run": "the name of a command that wants more words",
    "dask scheduler": "tests/analysis/test_cluster.py",
    "dask worker tcp://HOST:8786": "tests/analysis/test_cluster.py",
    "flexlab --law tcp://HOST:PORT": "tests/control/test_law_elsewhere.py",
    "flexlab --law tcp://localhost:9000": "tests/control/test_law_elsewhere.py",
    "flexlab --law controller.fmu": "tests/fmi/test_unit_as_law.py",
    'pip install "flexlab[fmu]"': "tests/test_dependencies.py",
    "flexlab export PRESET --to law.fmu --part law": "tests/fmi/test_unit_as_law.py",
    "at.from_torques(...)": "tests/control/test_own_law.py",
    "largest(vibration)": "tests/analysis/test_lesson_checks.py",
    "rms(tracking_error[0:2])": "tests/analysis/test_lesson_checks.py",
}
"""What is not tried here → where it is tried, or why not."""
USUAL = ("flexlab presets --schema", "flexlab fit newest", "flexlab logs RUN")
"""Commands that are always tried."""
STANDS_FOR = (
    (" PRESET …", " paper"),
    ("PRESET --vary …", "paper --vary payload.bending_stiffness=50,100 --duration 0.2"),
    ("PRESET --change …", "paper --change controller.feedback_gain=50:800 --duration 0.2 --candidates 16"),
    ("flexlab export [RUN]", "flexlab export --to all.csv"),
    (" [RUN …]", ""),
    (" [RUN]", ""),
    (" [PRESET]", ""),
    ("RUN RUN …", "RUN RUN"),
    ("RUN RUN", "{other} RUN"),
    ("newest RUN", "newest {other}"),
    ("RUN", "{tapped}"),
    ("FILE.csv", "run.csv"),
    ("FILE", "run.csv"),
)
"""Placeholders in the texts, and what a reader writes in their place."""
NEVER = 4e9
"""A date in the far future, s since 1970: a recording of this date is newer than all that the commands make."""
CACHE = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
LONGEST = 1500.0
"""Longest time of a command on a busy machine, s: `bench` with its cold start takes ten minutes on a slow, idle one."""


def written(root: Path) -> tuple[list[str], list[str]]:
    """Return (commands, Python snippets) of the documents as they are written, each once."""
    pieces: list[str] = []
    for document in DOCUMENTS:
        for code in CODE.finditer((root / document).read_text(encoding="utf-8")):
            if code["words"]:
                pieces.append(" ".join(code["words"].split()))
            elif code["kind"] == "python":
                pieces.append(code["block"])
            elif code["kind"] in ("sh", ""):
                pieces += [re.sub(r"\s+#.*", "", line) for line in code["block"].splitlines()]
    unique = list(dict.fromkeys(pieces))
    commands = [piece for piece in unique if COMMAND.match(piece)]
    return commands, [piece for piece in unique if piece not in commands and SNIPPET.match(piece)]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "command" in metafunc.fixturenames:
        wanted = metafunc.config.getoption("documented")
        commands, _ = written(Path(__file__).parents[1])
        tried = [command for command in commands if command not in OF_THE_CHECKOUT | ELSEWHERE.keys()]
        metafunc.parametrize("command", [command for command in tried if wanted or command in USUAL])


def test_every_command_that_is_not_tried_is_still_in_the_documents(root: Path):
    commands, snippets = written(root)
    assert {*OF_THE_CHECKOUT, *ELSEWHERE} - {*commands, *snippets} == set()
    assert [
        file for file in ELSEWHERE.values() if file.startswith("tests/") and not (root / file.split()[0]).exists()
    ] == []


@pytest.fixture(scope="module")
def folder(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A reader's working folder, with the files and runs that the texts mention."""
    folder = tmp_path_factory.mktemp("reader")
    for snippet in written(root)[1]:
        for name in (
            ("soft_pi.py", "my_law.py") if "(OwnLaw)" in snippet else ("eight.py",) if "(OwnPath)" in snippet else ()
        ):
            (folder / name).write_text(snippet, encoding="utf-8")
    record_runs(folder / "logs")
    for file in ("run.csv", "run.zip"):
        with contextlib.chdir(folder), pytest.raises(SystemExit, match="0"):
            main(["export", "newest", "--to", file])
    ring = ((t, 3 * math.exp(-6 * t) * math.cos(300 * t)) for t in (0.0005 * k for k in range(800)))
    lines = ["t [ms],laser [mm]", *(f"{1e3 * t:.4f},{deflection:.9f}" for t, deflection in ring)]
    (folder / "mine.csv").write_text("\n".join(lines), encoding="utf-8")
    return folder


def record_runs(logs: Path) -> None:
    """Record two runs as a lab does; the one in which the beam is tapped is the newest and stays so."""
    tap = Tap(0.05, (0.0, 0.3))
    for name, commands in (("other", []), ("tapped", [(0.5, tap)])):
        run = flexlab.simulate("smooth-start", 1.5, commands=commands)
        with HeadlessRecording(logs, RunInfo(name, run.scenario)) as recording:
            recording.write(run)
            for time, command in commands:
                recording.note(Event(time, "tap", command))
            recording.end(run.status)
    os.utime(recording.path, (NEVER, NEVER))


def flexlab_in(folder: Path, command: str) -> str:
    """Run a command as a user's shell does, end it with Ctrl-C once it shows a page, and return its output.

    Raises `AssertionError` if it fails.
    """
    circumstances = {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}", "SHELL": "/bin/bash"}
    circumstances |= {"HOME": str(folder), "XDG_CACHE_HOME": CACHE, "NO_COLOR": "1", "PYTHONUNBUFFERED": "1"}
    with (folder / "said.txt").open("w+", encoding="utf-8") as said:
        process = subprocess.Popen(
            ["sh", "-c", f"exec {command}"], cwd=folder, env=os.environ | circumstances, stdin=subprocess.DEVNULL,
            stdout=said, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        try:
            text = functools.partial((folder / "said.txt").read_text, encoding="utf-8")
            wait_until(lambda: process.poll() is not None or "Ctrl-C" in text(), command, LONGEST)
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            assert process.wait(LONGEST) == 0, f"{command}: {text()}"
            assert "Traceback" not in text()
            return text()
        finally:
            process.kill()


@pytest.mark.timeout(2 * LONGEST)
def test_a_documented_command_runs(folder: Path, command: str):
    # The first run of each name: an import makes another.
    runs = {name: min(folder.glob(f"logs/*-{name}.rrd")).stem for name in ("tapped", "other")}
    for left_open, filled in STANDS_FOR:
        command = command.replace(left_open, filled.format(**runs))
    assert re.search(r"[A-Z…]{3,}", command) is None, "every place is filled"
    flexlab_in(folder, command)


def test_every_snippet_runs(folder: Path):
    _, snippets = written(Path(__file__).parents[1])
    program = ["import flexlab, gymnasium, numpy, pandas", "display = repr", "run = flexlab.simulate('paper', 0.5)"]
    for snippet in snippets:
        if snippet in ELSEWHERE:
            continue
        whole = f"value{snippet}" if snippet.startswith(".") else snippet.replace("[...]", "['paper']")
        if re.match(r"(flexlab|run|pandas|numpy)\.", whole):
            whole = f"value = {whole}"
        program.append(whole)
    subprocess.run([sys.executable, "-c", "\n".join(program)], cwd=folder, stdin=subprocess.DEVNULL, check=True)
