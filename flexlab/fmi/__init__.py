"""A scenario as a functional mock-up unit for co-simulation: one file that other tools simulate without Python.

It holds the kernels' own machine code, so that it gives the same bits as `flexlab.simulate`.
"""

import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import zipfile
from collections.abc import Sequence
from importlib.metadata import distribution
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from flexlab import __version__
from flexlab.compiled import PLAIN_PYTHON
from flexlab.errors import StudyError
from flexlab.files import filled, writing
from flexlab.fmi.description import Model, model_description
from flexlab.fmi.machine_code import bits, data_object, write_object
from flexlab.fmi.parts import Part, make_part
from flexlab.presets import scenario_text
from flexlab.scenario import Scenario
from flexlab.sim.simulate import sample_count
from flexlab.sim.snapshot import TICK

VERSIONS = (2, 3)
IDENTIFIER = "flexlab_unit"
USUAL_DURATION = 3.0
"""Time that importers simulate by default, s."""
SOURCES = Path(__file__).parent / "c"
DOCUMENTATION = Path(__file__).with_name("documentation.html")
PLATFORMS = {
    ("Linux", "x86_64"): ("linux64", "x86_64-linux", ".so"),
    ("Linux", "aarch64"): ("aarch64-linux", "aarch64-linux", ".so"),
    ("Darwin", "x86_64"): ("darwin64", "x86_64-darwin", ".dylib"),
    ("Darwin", "arm64"): ("aarch64-darwin", "aarch64-darwin", ".dylib"),
}
"""Folder of the binary in FMI 2 and 3, and its suffix."""


def write_fmu(
    scenario: Scenario,
    file: Path,
    name: str = "scenario",
    part: str = "plant",
    version: int = 3,
    tick_period: float = TICK,
) -> None:
    """Write a unit, whole or not at all. Raises `StudyError` or `ScenarioError`.

    `part`: "plant", whose motors' torques are inputs; "law", whose inputs are its measurements; "loop", which is plant, law
    and path as `flexlab.simulate` has them; or "follower", plant and law, whose input is the desired motion.
    `version` of FMI: 2 or 3. `tick_period`: time between two instants at which importers may read outputs, s.
    """
    if type(version) is not int or version not in VERSIONS:
        raise StudyError(f"fmi = {version!r:.60} is not a version that can be written: choose 2 or 3.")
    place = PLATFORMS.get((platform.system(), platform.machine()))
    if place is None or PLAIN_PYTHON:
        what = "the kernels are not compiled (NUMBA_DISABLE_JIT)" if PLAIN_PYTHON else "this is neither Linux nor macOS"
        raise StudyError(f"A unit of machine code cannot be made here: {what}.")
    sample_count(0.0, tick_period)
    made = make_part(scenario, part, tick_period)
    with writing(file) as draft, TemporaryDirectory(prefix="flexlab-") as folder:
        _write(Path(folder), draft, made, f"{name} ({part})", version, place)


def _write(folder: Path, file: Path, part: Part, name: str, version: int, place: tuple[str, str, str]) -> None:
    text = scenario_text(part.scenario)
    token = hashlib.sha256(f"{__version__} {version} {name} {part.tick_period} {text}".encode()).hexdigest()[:32]
    tool = f"flexlab {__version__}"
    model = Model(name, IDENTIFIER, token, part.about, tool, part.tick_period, USUAL_DURATION)
    header, data = _layout(part, token)
    (folder / "layout.h").write_text(header, encoding="utf-8")
    (folder / "data.o").write_bytes(data_object(data, "flexlab_data"))
    for kernel, result in part.kernels.items():
        write_object(result, kernel, folder / f"{kernel}.o", by_words=True)
    for each in part.called:
        write_object(each.result, each.name, folder / f"{each.name}.o")
    objects = [folder / f"{each}.o" for each in (*part.kernels, "data", *(each.name for each in part.called))]
    binary = folder / f"{IDENTIFIER}{place[2]}"
    sources = "".join(f'#include "{each}"\n' for each in ("unit.c", part.source, f"fmi{version}.c"))
    (folder / "whole.c").write_text(sources, encoding="utf-8")  # One translation unit compiles faster than three.
    _link(binary, [folder / "whole.c", *objects], folder)
    licence = distribution("flexlab").read_text("licenses/LICENSE") or "MIT License: https://spdx.org/licenses/MIT\n"
    files = {
        "modelDescription.xml": model_description(version, model, part.variables),
        f"binaries/{place[version - 2]}/{binary.name}": binary.read_bytes(),
        "documentation/index.html": filled(DOCUMENTATION, model=model, variables=part.variables).encode(),
        "documentation/licenses/license.txt": licence.encode(),
        "resources/scenario.json": text.encode(),
    }
    with zipfile.ZipFile(file, "w") as archive:
        for path, content in files.items():  # Without a date, so that the same scenario gives the same bytes.
            archive.writestr(zipfile.ZipInfo(path), content, zipfile.ZIP_DEFLATED)


def _layout(part: Part, token: str) -> tuple[str, bytes]:
    """The text of layout.h, and the data that it describes."""
    memory, calls = part.memory, []
    for number, each in enumerate(part.called):  # Each instance fills in the addresses of its own process.
        at = memory.word(each.word) if each.word else memory.places["gains"] + 8 * each.gain
        if each.word:
            memory.words[at] = 0
        else:
            memory.own[at : at + 8] = 0
        calls += [int(bool(each.word)), at, number]
    tables = {
        "WORDS": memory.words,
        "KINDS": memory.kinds,
        "SCHEMES": [value for scheme in memory.schemes for value in scheme],
        "PIECES": [value for piece in memory.pieces for value in piece.words],
        "CALLS": calls,
        "FIRST": part.first_words,
        "VARIABLES": [
            value
            for each in part.variables
            for value in (each.place, each.is_settable + each.is_whole, bits(float(each.low)), bits(float(each.high)))
        ],
    }
    blocks = {name: np.array(values, np.int64).tobytes() for name, values in tables.items()}
    blocks |= {"OWN": memory.own.tobytes(), "SHARED": memory.shared.tobytes()}
    data, at = bytearray(), {}
    for name, block in blocks.items():
        data += bytes(-len(data) % 64)
        at[f"AT_{name}"] = len(data)
        data += block
    numbers = at | part.numbers
    numbers |= {
        "WORD_COUNT": len(memory.words),
        "VARIABLE_COUNT": len(part.variables),
        "CALL_COUNT": len(calls) // 3,
        "OWN_SIZE": len(memory.own),
        "STATE_SIZE": memory.state_size,
        "AT_Y": memory.places["y"],
        "AT_GRAVITY": memory.places["gravity"],
        "WORD_GRAVITY": memory.word("system.plant.gravity"),
        "AT_SEED": memory.places["seed"],
        "WORD_SEED": memory.word("sampling.seed"),
        "FIRST_COUNT": len(part.first_words),
        "AT_DESIRED_TIME": memory.places["ws.desired_time.data"],
    }
    names = [each.name for each in part.called]
    lines = [f"#define {name} {value}" for name, value in numbers.items()] + [
        f"#define FUNCTIONS {', '.join(f'{name}(void)' for name in names)}",
        f"#define FUNCTION_NAMES {', '.join(names)}",
        f"#define TICK_PERIOD {part.tick_period!r}",
        f'#define TOKEN "{token}"',
    ]
    return "\n".join(lines) + "\n", bytes(data)


def _link(binary: Path, parts: Sequence[Path], headers: Path) -> None:
    """Compile and link a C source and object files with the machine's C compiler. Raises `StudyError`."""
    compiler = shlex.split(os.environ.get("CC", "cc"))
    if not compiler or shutil.which(compiler[0]) is None:
        raise StudyError(
            f"A unit is linked by a C compiler, and {' '.join(compiler) or 'CC'} was not found: install one (gcc or clang), or "
            "name yours in the environment variable CC."
        )
    options = "-shared -fPIC -O1 -std=c11 -fvisibility=hidden -ffp-contract=off".split()
    folders = [f"-I{headers}", f"-I{SOURCES}"]
    command = [*compiler, *options, *folders, *map(str, parts), "-lm", "-o", str(binary)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or [f"{compiler[0]} ended with {done.returncode}"]
        raise StudyError(f"The C compiler could not link the unit: {lines[-1]}")
