"""README keeps its promises: its example runs, its tables are complete, its commands exist."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from flexlab.cli import COMMANDS
from flexlab.presets import preset_names


@pytest.fixture(scope="module")
def readme(root: Path) -> str:
    return (root / "README.md").read_text(encoding="utf-8")


def test_the_python_example_runs(readme: str, tmp_path: Path):
    example, *_ = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    done = subprocess.run(
        [sys.executable, "-c", example], cwd=tmp_path, capture_output=True, text=True, encoding="utf-8", check=True
    )
    assert done.stdout.startswith("Over t = 0 s to 3 s:\n  Duration (s)")
    assert "\nfinished [0.016" in done.stdout
    assert done.stdout.endswith(" mm\n")


def test_the_preset_table_names_presets_in_the_order_of_the_menu(readme: str):
    table = readme.split("## Presets")[1].split("##")[0]
    named = re.findall(r"^\| `([\w-]+)` \|", table, re.MULTILINE)
    assert len(named) > 10
    assert named == [name for name in preset_names() if name in named]


def test_the_command_table_names_commands(readme: str):
    table = readme.split("## On the command line")[1].split("##")[0]
    named = {words.split()[0] for words in re.findall(r"^\| `flexlab ([^`]*)`", table, re.MULTILINE)}
    assert len(named) > 10
    assert named <= set(COMMANDS), "the documentation has all of them"


def test_the_set_up_commands_use_files_that_exist(readme: str, root: Path):
    for line in re.findall(r"```sh\n(.*?)```", readme, re.DOTALL):
        for file in re.findall(r"-c (\S+)|python (tests/\S+)", line):
            assert (root / "".join(file)).is_file()
    assert "://" not in (root / "constraints.txt").read_text(encoding="utf-8")


def test_links_lead_to_files(readme: str, root: Path):
    linked = re.findall(r"\]\((?!http)([^)#]+)", readme)
    assert len(linked) > 5
    assert [link for link in linked if not (root / link).is_file()] == []


def test_the_citation_is_of_the_newest_release(root: Path):
    """`.github/CITATION.cff` has the newest release of the changelog, with its date."""
    release, date = re.findall(
        r"^## (\S+) \((\S+)\)", (root / ".github/CHANGELOG.md").read_text(encoding="utf-8"), re.M
    )[0]
    lines = (root / ".github/CITATION.cff").read_text(encoding="utf-8").splitlines()
    assert {f"version: {release}", f"date-released: {date}"} <= set(lines)
