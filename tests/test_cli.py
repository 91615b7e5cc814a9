"""The command line says what it can do and answers bad input with one sentence, never a traceback."""

import io
import json
import os
import shlex
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path

import pytest
from lab_process import Command, refused

from flexlab.cli import COMMANDS, main
from flexlab.presets import load_preset, load_scenario_file, preset_names, save_scenario
from flexlab.scenario import Scenario

HELP = """
import contextlib, io, json, sys
import flexlab.cli
from flexlab.cli.console import notes, output

said = {}
for name in flexlab.cli.COMMANDS:
    output.cache_clear()
    with contextlib.redirect_stdout(io.StringIO()) as text, contextlib.redirect_stderr(io.StringIO()) as complaints:
        try:
            flexlab.cli.main([name, "--help"])
        except SystemExit as end:
            code = end.code
    heavy = sorted({"numba", "scipy", "viser", "rerun", "pyarrow"} & set(sys.modules))
    said[name] = [code, text.getvalue(), complaints.getvalue(), heavy]
print(json.dumps(said))
"""


@pytest.fixture(scope="module")
def explained() -> dict[str, list]:
    """For each command: exit code, output and errors of its `--help`, and the heavy libraries loaded by then."""
    return json.loads(subprocess.run([sys.executable, "-c", HELP], capture_output=True, text=True, check=True).stdout)


def test_help_shows_every_command(flexlab_process: Command):
    done = flexlab_process("--help")
    assert done.returncode == 0
    for name in set(COMMANDS) - {"lab"}:
        assert f"  flexlab {name}" in done.stdout
    for option in ("--preset", "--host", "--port", "--no-browser", "--rerun", "--logs"):
        assert option in done.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_that_loads_no_heavy_library(explained: dict[str, list], name: str):
    code, said, complained, heavy = explained[name]
    assert (code, complained, heavy) == (0, "", [])
    assert said.startswith(f"usage: flexlab {name}")


def test_version(flexlab_process: Command):
    from flexlab import __version__

    assert flexlab_process("--version").stdout == f"flexlab {__version__}\n"


def test_presets_are_listed_with_what_to_watch(flexlab_command: Command):
    done = flexlab_command("presets")
    assert done.returncode == 0
    for name in preset_names():
        assert name in done.stdout
    assert "45.5 Hz" in " ".join(done.stdout.split())


@pytest.mark.parametrize(("words", "expected"), [(("presets",), "paper "), (("run", "--help"), "usage: flexlab run")])
def test_a_terminal_of_no_width_is_written_to_as_one_of_40_columns(
    flexlab_command: Command, words: tuple[str, ...], expected: str
):
    # With one column the help took minutes; with none there were no presets.
    said = [flexlab_command(*words, COLUMNS=columns).stdout for columns in ("0", "1", "40")]
    assert said[0] == said[1] == said[2]
    assert said[2].startswith(expected)


@pytest.mark.parametrize("size", ["²", "-5", "x", "", "9" * 5000])
def test_a_terminal_of_unknown_size_is_written_to(flexlab_command: Command, size: str):
    done = flexlab_command("presets", COLUMNS=size, LINES=size)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("paper ")


def test_a_changed_preset_is_printed_as_a_scenario_file(flexlab_command: Command, tmp_path: Path):
    done = flexlab_command("presets", "soft-beam", "--set", "gravity=9.81", "--law", "pd")
    assert done.returncode == 0, done.stderr
    (tmp_path / "mine.json").write_text(done.stdout, encoding="utf-8")
    wanted = load_preset("soft-beam").replace({"gravity": 9.81, "controller.kind": "pd"})
    assert load_scenario_file(tmp_path / "mine.json") == wanted
    listed = json.loads(flexlab_command("presets", "--json").stdout)
    assert [preset["name"] for preset in listed] == preset_names()
    assert listed[0]["payload"]["bending_stiffness"] == 100.0
    assert "Say which preset to change" in refused(flexlab_command("presets", "--law", "pd"))
    assert "give nothing else with it" in refused(flexlab_command("presets", "paper", "--schema"))
    assert "did you mean gravity?" in refused(flexlab_command("presets", "paper", "--set", "gravty=1"))


def test_own_presets_are_listed_and_broken_ones_named(flexlab_command: Command, tmp_path: Path):
    (tmp_path / "presets").mkdir()
    save_scenario(Scenario(title="My [red]own[/red] one"), tmp_path / "presets" / "mine.json")
    (tmp_path / "presets" / "broken.json").write_text("{")
    done = flexlab_command("presets")
    assert "My [red]own[/red] one" in done.stdout
    assert "broken.json" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.returncode == 2


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("run paper --law pd --law lqr", "--law is given twice: give it once, as only its last value would count."),
        ("run paper --duration=1 --seed 1 --duration 2", "--duration is given twice"),
        ("tune paper --search-seed 1 --search_seed 1", "--search-seed is given twice"),
        ("lab --port 1 --port 2", "--port is given twice"),
        ("--port 1 --port 2", "--port is given twice"),
        ("logs --logs= --json", "--logs is empty: name a file or folder, or . for this folder."),
        ("run paper --logs EMPTY --duration 1", "--logs is empty"),
        ("tune paper --change gravity=0:1 --save EMPTY", "--save is empty"),
        ("validate --to EMPTY", "--to is empty"),
        ("lab --host EMPTY", "host is empty"),
    ],
)
def test_an_option_that_is_given_twice_or_names_no_file_is_refused(flexlab_command: Command, words: str, says: str):
    assert says in refused(flexlab_command(*("" if word == "EMPTY" else word for word in words.split())))


def test_an_option_of_several_values_is_given_several_times(flexlab_command: Command):
    done = flexlab_command(
        "presets", "paper", "--set", "gravity=2", "--set", "payload.length=0.7", "--set=grips.model=rigid"
    )
    changed = json.loads(done.stdout)
    assert (changed["gravity"], changed["payload"]["length"]) == (2.0, 0.7)


def test_an_unknown_command_is_one_sentence(flexlab_process: Command, flexlab_command: Command):
    assert "did you mean presets?" in refused(flexlab_process("prests"))
    assert "leaderboard, logs" in refused(flexlab_command("zzz"))
    assert "give one of --verify and --to" in refused(flexlab_command("leaderboard", "--verify", "--to", "report"))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("run paper --duration 1,5", "--duration '1,5' is not usable: give a number, as in 1.5."),
        ("run paper --duration=0x10", "--duration '0x10' is not usable: give a number, as in 1.5."),
        ("run paper --seed None", "--seed 'None' is not usable: give a whole number."),
        ("run paper --seed 1e3", "--seed '1e3' is not usable: give a whole number."),
        ("--port many", "--port 'many' is not usable: give a whole number."),
        ("logs --max-size 1GB", "--max-size '1GB' is not usable: give a number, as in 1.5."),
        ("sweep paper --samples 2.0", "--samples '2.0' is not usable: give a whole number."),
    ],
)
def test_what_is_no_number_is_refused_in_one_sentence(flexlab_command: Command, words: str, says: str):
    """The answer was a frame with "<class 'NoneType'>: ['1e3'] does not match choices ('None',)"."""
    assert refused(flexlab_command(*words.split())) == f"{says}\n"


@pytest.mark.parametrize("words", [["--preset"], ["--prot", "1"], ["run"], ["--port"], ["run", "paper", "-x"]])
def test_wrong_options_are_explained(flexlab_command: Command, words: list[str]):
    done = flexlab_command(*words)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "--help" in done.stderr


@pytest.mark.parametrize("errors", ["", "2>&-"])
def test_a_closed_pipe_is_no_error(root: Path, errors: str):
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {shlex.quote(sys.executable)} -m flexlab --help {errors} | head -1"],
        capture_output=True,
        text=True,
        check=True,
        cwd=root,
    )
    assert done.stderr == ""


def test_an_error_that_cannot_be_told_keeps_its_exit_code():
    with open("/dev/full", "w") as full:
        done = subprocess.run([sys.executable, "-m", "flexlab", "prests"], stderr=full, check=False)
    assert done.returncode == 2


def test_the_exit_code_says_nothing_of_a_closed_pipe(root: Path):
    """It was 1, that of a run that failed."""
    program = "from flexlab.cli import main; import sys; sys.stdin.readline(); main(['--help'])"
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=root
    ) as printing:
        assert printing.stdin is not None
        assert printing.stdout is not None
        assert printing.stderr is not None
        printing.stdout.close()
        printing.stdin.write(b"\n")
        printing.stdin.flush()
        assert (printing.wait(), printing.stderr.read()) == (0, b"")


@pytest.mark.parametrize("encoding", ["cp1252", "ascii", "utf-8"])
def test_a_preset_printed_in_any_encoding_is_a_scenario_file(encoding: str, tmp_path: Path):
    """Windows writes to a file in an encoding of its own, and its PowerShell turns that into UTF-16."""
    with redirect_stdout(io.TextIOWrapper(io.BytesIO(), encoding=encoding)) as said, pytest.raises(SystemExit):
        main(["presets", "lqr"])
    printed = said.buffer.getvalue()
    (tmp_path / "mine.json").write_bytes(printed)
    assert load_scenario_file(tmp_path / "mine.json") == load_preset("lqr")
    (tmp_path / "by_powershell.json").write_text(printed.decode(encoding), encoding="utf-16", newline="\r\n")
    assert load_scenario_file(tmp_path / "by_powershell.json") == load_preset("lqr")


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("words", [["--version"], ["--help"], ["presets", "paper"], ["completion", "bash"]])
def test_output_to_a_full_disk_ends_in_one_sentence(words: list[str], unbuffered: str):
    command = [sys.executable, "-m", "flexlab", *words]
    environment = os.environ | {"PYTHONUNBUFFERED": unbuffered}
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, env=environment, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert " ".join(done.stderr.split()) == (
        "The output cannot be written (No space left on device): make room or send it elsewhere."
    )
