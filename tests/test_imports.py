"""Each room (a module or package directly in flexlab) imports no higher layer, and some outside libraries have their own room."""

import ast
import re
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

LAYERS = {
    "__version__": 0,  # defined in flexlab/__init__.py before anything else
    "errors": 0,
    "files": 0,
    "machine": 0,
    "notation": 0,
    "compiled": 0,
    "assets": 0,
    "sockets": 0,
    "interrupts": 0,
    "quantities": 0,
    "signal": 0,
    "text": 0,
    "arguments": 0,
    "boundaries": 0,
    "registry": 0,
    "lapack": 0,
    "numba_internals": 0,
    "numerics": 1,
    "physics": 2,
    "control": 3,
    "own": 4,
    "scenario": 5,
    "presets": 5,
    "guide": 5,
    "sim": 6,
    "views": 6,
    "multibody": 7,
    "recording": 7,
    "lab": 7,
    "analysis": 7,
    "fmi": 7,
    "gym_environment": 7,
    "api": 8,
    "study_api": 8,
    "notebook": 8,
    "jupyter": 8,
    "benchmarks": 9,
    "": 8,  # flexlab/__init__.py, the names of the Python interface
    "server": 9,
    "cli": 10,
    "__main__": 11,
}
CLOSED_ROOMS = {"recording", "lab"}
"""Rooms that may not import each other: a lab works without a recorder and the other way round."""

HOMES = {
    "viser": {"lab"},
    "rerun": {"recording"},
    "aiohttp": {"server"},
    "tyro": {"cli"},
    "gymnasium": {"gym_environment"},
}
"""Outside libraries that shape all code around them, and the only rooms that may import them."""

FREE_OF_CONFIGURATION = {"numerics", "physics"}
"""Rooms that compute with plain numbers and know no scenarios."""


def imports(file: Path, package: Path) -> Iterator[tuple[str, int]]:
    """Yield (absolute module or module.name, line) for every import in a file, also those inside functions.

    Imports under `if TYPE_CHECKING` count too: a type is a dependency.
    """
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node.lineno
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}:{node.lineno}: write absolute imports"
            for alias in node.names:
                yield f"{node.module}.{alias.name}", node.lineno
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "import_module":
            by_name = file.is_relative_to(package / "cli") or file in (package / "__init__.py", package / "registry.py")
            assert by_name, (
                f"{file}:{node.lineno}: only the command line, the Python interface and registries load by name"
            )


def room_of_file(file: Path, package: Path) -> str:
    """Return the first part of a file's module name below flexlab; "" for flexlab/__init__.py."""
    first = file.relative_to(package).parts[0]
    return "" if first.startswith("__init__.py") else first.removesuffix(".py")


def room_of_module(module: str) -> str | None:
    """Return the room of an imported name, or None if it is not of flexlab."""
    parts = module.split(".")
    if parts[0] != "flexlab":
        return None
    return parts[1] if len(parts) > 1 and parts[1] in LAYERS else ""


def problems(package: Path) -> list[str]:
    """Return one sentence for each import that is not allowed."""
    found = []
    for file in sorted([*package.rglob("*.py"), *package.rglob("*.pyi")]):
        room = room_of_file(file, package)
        if room not in LAYERS:
            found.append(f"{file}: the room {room} has no layer: give it one in LAYERS")
            continue
        for module, line in imports(file, package):
            where = f"{file.relative_to(package.parent)}:{line} imports {module}"
            other = room_of_module(module)
            library = module.split(".")[0]
            if other is None:
                if library in HOMES and room not in HOMES[library]:
                    found.append(f"{where}: only {', '.join(HOMES[library])} may")
            elif LAYERS[other] > LAYERS[room]:
                found.append(f"{where}: that points upwards, from layer {LAYERS[room]} to {LAYERS[other]}")
            elif other != room and {other, room} == CLOSED_ROOMS:
                found.append(f"{where}: {room} and {other} may not know each other")
            elif room in FREE_OF_CONFIGURATION and other in ("scenario", "presets", "quantities"):
                found.append(f"{where}: {room} speaks numbers, not scenarios")
    return found


def test_no_import_points_to_a_higher_layer(root: Path):
    assert problems(root / "flexlab") == []


def test_no_modules_import_each_other_in_a_circle(root: Path):
    """Not within functions either, where a circle would do no harm until somebody moves the import."""
    package = root / "flexlab"
    files = {".".join(file.relative_to(root).with_suffix("").parts): file for file in package.rglob("*.py")}
    files = {name.removesuffix(".__init__"): file for name, file in files.items()}
    imported = {name: [module for module, _ in imports(file, package)] for name, file in files.items()}
    graph = {
        name: {module if module in files else module.rpartition(".")[0] for module in modules} & files.keys()
        for name, modules in imported.items()
    }
    del graph["flexlab"]  # It knows all names of the Python interface, and loads what they are in when asked.
    TopologicalSorter(graph).prepare()


def test_contributing_lists_the_folders_in_the_order_of_their_layers(root: Path):
    table = (
        (root / ".github/CONTRIBUTING.md").read_text(encoding="utf-8").split("## Where things are")[1].split("##")[0]
    )
    rooms = re.findall(r"`flexlab/(\w+)/`", table)
    assert [LAYERS[room] for room in rooms] == sorted(LAYERS[room] for room in rooms)
    folders = {file.parent.name for file in root.glob("flexlab/*/__init__.py")}
    assert folders == set(rooms)


@pytest.mark.parametrize(
    ("room", "line"),
    [
        ("physics", "import flexlab.sim.world"),
        ("physics", "from flexlab import scenario"),
        ("control", "def f():\n    from flexlab.sim import world"),
        ("sim", "from flexlab.lab.session import Session"),
        ("sim", "import flexlab"),
        ("recording", "from flexlab.lab import scene"),
        ("lab", "from flexlab.recording import writer"),
        ("sim", "import viser"),
        ("lab", "import rerun as rr"),
        ("analysis", "from flexlab.cli import main"),
        ("attic", "import math"),
    ],
)
def test_a_forbidden_import_is_found(tmp_path: Path, room: str, line: str):
    package = tmp_path / "flexlab"
    (package / room).mkdir(parents=True)
    (package / room / "new.py").write_text(line + "\n")
    assert len(problems(package)) == 1


def test_allowed_imports_are_left_alone(tmp_path: Path):
    package = tmp_path / "flexlab"
    package.mkdir()
    (package / "lab").mkdir()
    (package / "lab" / "new.py").write_text("import viser\nfrom flexlab.sim.world import World\nimport numpy\n")
    (package / "__init__.py").write_text("from flexlab.sim.samples import Run\n")
    assert problems(package) == []
