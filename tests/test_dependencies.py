"""What the code imports is what pyproject asks for, and constraints.txt pins all of it."""

import ast
import re
import sys
import tomllib
from functools import cache
from importlib.metadata import distributions, packages_distributions, requires
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

DISTRIBUTIONS = {"rerun_bindings": "rerun-sdk", "rerun_cli": "rerun-sdk", "pinocchio": "pin", "mujoco": "mujoco"}
"""Distribution of each module whose own name does not tell it."""

FOR_TYPES = {"pandas"}
"""Only imported for the type of a table that pyarrow makes for users who have it."""

BY_HAND = {"omsimulator"}
"""Built from its sources by those who run `peers/om_simulator.py`: the package index has none that installs."""

TOOLS = {"hatchling", "pyright", "ruff", "pytest", "pytest-timeout"}
"""Programs of the extra `test` that are run, not imported."""


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def requirement_name(line: str) -> str:
    found = re.match(r"[\w.-]+", line)
    assert found
    return normal(found[0])


@pytest.fixture(scope="module")
def project(root: Path) -> dict:
    return tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.fixture(scope="module")
def pins(root: Path) -> dict[str, str]:
    lines = (root / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return {normal(name): version for name, version in (line.split("==") for line in lines if not line.startswith("#"))}


installed = cache(packages_distributions)


def imported(folder: Path) -> set[str]:
    """Return the distributions, as pyproject names them, of the outside modules that the files of a folder import."""
    modules = set()
    for file in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                modules |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                modules.add(node.module.split(".")[0])
    own = {path.stem for path in folder.rglob("*")} | {"flexlab"}
    homes = installed()
    outside = modules - own - set(sys.stdlib_module_names)
    # The peers need not be installed: their modules then keep their own names.
    return {normal(DISTRIBUTIONS.get(module) or homes.get(module, [module])[0]) for module in outside}


def test_the_package_asks_for_what_it_imports_and_no_more(root: Path, project: dict):
    asked = {requirement_name(line) for line in project["dependencies"]}
    extras = [lines for name, lines in project["optional-dependencies"].items() if name != "test"]
    optional = {requirement_name(line) for lines in extras for line in lines} | FOR_TYPES
    # pydantic brings this along as part of its own interface.
    found = imported(root / "flexlab") - optional - {"pydantic-core"}
    assert found == asked


def test_the_tests_ask_for_what_they_import(root: Path, project: dict):
    extras = project["optional-dependencies"]
    asked = {requirement_name(line) for line in project["dependencies"] + extras["test"] + extras["peers"]}
    assert imported(root / "tests") - {"pydantic-core"} - BY_HAND <= asked
    assert TOOLS <= asked


def test_everything_that_gets_installed_is_pinned(project: dict, pins: dict[str, str]):
    wanted = [requirement_name(line) for line in project["dependencies"] + project["optional-dependencies"]["test"]]
    seen = set()
    while wanted:
        name = wanted.pop()
        if name in seen:
            continue
        seen.add(name)
        assert name in pins, f"{name} is not in constraints.txt"
        for line in requires(name) or []:
            # Extras and other platforms are left out: this machine has neither.
            if ";" not in line:
                wanted.append(requirement_name(line))


def test_every_pin_is_one_exact_version(root: Path):
    for line in (root / "constraints.txt").read_text(encoding="utf-8").splitlines():
        assert line.startswith("#") or re.fullmatch(r"[\w.-]+==[\w.+!-]+", line), line


def test_all_pins_install_on_the_oldest_python_that_is_allowed(project: dict, pins: dict[str, str]) -> None:
    oldest = project["requires-python"].removeprefix(">=") + ".0"
    asked = {normal(each.metadata["Name"]): each.metadata.get("Requires-Python") or "" for each in distributions()}
    refusing = {name: asked[name] for name in pins if name in asked and oldest not in SpecifierSet(asked[name])}
    assert refusing == {}
