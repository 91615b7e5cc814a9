"""The shipped notebooks run from top to bottom and check their own results."""

import json
import runpy
from pathlib import Path

import pytest

NAMES = ("1-a-ring-read-off-a-run", "2-which-gain-for-which-beam")


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_runs_and_gives_the_kinds_of_output_it_is_shipped_with(root: Path, name: str):
    path = root / "web_assets" / "notebooks" / f"{name}.ipynb"
    run_notebook = runpy.run_path(str(root / "web_assets" / "make" / "notebooks.py"))["run_notebook"]
    shipped, ran = json.loads(path.read_text(encoding="utf-8")), run_notebook(path)

    def kinds(notebook: dict) -> list[list[str]]:
        cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
        return [[key for output in cell["outputs"] for key in output.get("data", {"stream": ""})] for cell in cells]

    assert kinds(shipped) == kinds(ran), "run web_assets/make/notebooks.py"
    assert any("image/png" in cell for cell in kinds(ran))
    sources = "".join("".join(cell["source"]) for cell in ran["cells"] if cell["cell_type"] == "code")
    assert sources.count("assert ") >= 3


def test_every_notebook_is_run(root: Path):
    assert {path.stem for path in (root / "web_assets" / "notebooks").glob("*.ipynb")} == set(NAMES)
