"""The documentation site builds without a warning, lists all that a user can name, and loads nothing from other servers."""

import html
import re
import subprocess
import sys
from pathlib import Path

import pytest

import flexlab
from flexlab import cli
from flexlab.analysis.metrics.metric import number_names
from flexlab.control.law import laws
from flexlab.control.path import paths
from flexlab.guide import chapters
from flexlab.notation import SYMBOLS
from flexlab.scenario import Scenario
from flexlab.scenario.validation_errors import value_paths
from flexlab.sim.signals import known_signals


@pytest.fixture(scope="module")
def site(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The whole site, built as CONTRIBUTING says."""
    folder = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--quiet",
        "-f",
        "web_assets/docs/mkdocs.yml",
        "-d",
        str(folder),
    ]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    return folder


def text_of(site: Path, page: str) -> str:
    """Return the text of a page without its tags."""
    return html.unescape(re.sub(r"<[^>]+>", "", (site / f"{page}.html").read_text(encoding="utf-8")))


def headings(site: Path, page: str) -> set[str]:
    found = re.findall(r"<h2[^>]*>(.*?)</h2>", (site / f"{page}.html").read_text(encoding="utf-8"), re.DOTALL)
    return {html.unescape(re.sub(r"<[^>]+>", "", each)).replace("¶", "").split()[0] for each in found}


def test_the_site_lists_all_that_a_user_can_name(site: Path):
    assert headings(site, "laws") == set(laws())
    assert headings(site, "paths") >= set(paths())
    assert headings(site, "commands") == set(cli.COMMANDS)
    assert headings(site, "python") == set(flexlab.__all__) - {"__version__"}
    for page, names in {
        "fields": value_paths(Scenario()),
        "signals": known_signals(),
        "metrics": number_names(),
        "symbols": (symbol.word for symbol in SYMBOLS),
    }.items():
        shown = text_of(site, page)
        assert [name for name in names if name not in shown] == []
    for chapter in chapters():
        assert chapter.title in text_of(site, f"guide/{chapter.id}")


def test_the_site_explains_the_options_of_commands(site: Path):
    shown = text_of(site, "commands")
    for words in ("--sample-period S", "Time between samples, s.", "--set PATH=VALUE", "RUN"):
        assert words in shown


def test_no_page_loads_anything_from_another_server(site: Path):
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        asked = re.findall(r'<(?:script|link|img|iframe)[^>]+(?:src|href)="(https?:[^"]+)"', text)
        assert [address for address in asked if "canonical" not in address] == [], page.name
