"""Functional mock-up units that are exported once for all tests; without a C compiler these are skipped."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from flexlab.fmi import write_fmu
from flexlab.scenario import Scenario


@pytest.fixture(autouse=True)
def _compiler() -> None:
    if shutil.which("cc") is None and not os.environ.get("CI"):
        pytest.skip("no C compiler (cc): units are not looked at")


@pytest.fixture(scope="session")
def export(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """A function that exports a unit, once for all tests, and returns its file."""
    folder, known = tmp_path_factory.mktemp("units"), {}

    def written(scenario: Scenario, part: str = "loop", version: int = 3) -> Path:
        key = scenario.model_dump_json(), part, version
        if key not in known:
            known[key] = folder / f"unit-{len(known)}.fmu"
            write_fmu(scenario, known[key], "test", part, version)
        return known[key]

    return written
