"""A look at how a sweep is computed, for the tests of studies."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from flexlab.analysis.sweep import result
from flexlab.analysis.sweep.plan import Cell, Plan


@pytest.fixture
def computed_parts(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """File names of the parts that sweeps in this process compute and save, in order."""
    names, save = list[str](), result.save_part

    def saved(folder: Path, plan: Plan, cells: Sequence[Cell]) -> None:
        save(folder, plan, cells)
        names.append(result.part_file(folder, range(cells[0].number, cells[-1].number + 1)).name)

    monkeypatch.setattr(result, "save_part", saved)
    return names
