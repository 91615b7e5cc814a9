"""The same scenario gives the same bits with every BLAS, C library, numpy dispatch and instruction set that this machine has.

Runs of every preset, law, path, integrator and live change are made in processes whose libraries and compiler are told
that they run on another processor, and their hashes are compared.
"""

import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from lab_process import Lab, answer

from flexlab.assets import user_cache
from flexlab.cli.warmup import remove_unused
from flexlab.compiled import PLAIN_PYTHON, cache_folder
from flexlab.sockets import free_ports

RUNS = Path(__file__).with_name("same_bits_runs.py")
PATIENCE = 1200
"""Time limit, s, for all runs of one environment: compiling for another processor takes minutes on a busy one."""
pytestmark = pytest.mark.timeout(PATIENCE + 60)

ON_X86 = platform.machine() in ("x86_64", "AMD64")

WITHOUT_FUSED = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4"}
OTHER_NUMPY = {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"}
ENVIRONMENTS = {
    "an old processor": {"OPENBLAS_CORETYPE": "Prescott", **WITHOUT_FUSED, **OTHER_NUMPY},
    "Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "SkylakeX": {"OPENBLAS_CORETYPE": "SkylakeX"},
}
"""Environments for which nothing is compiled anew."""


def features() -> set[str]:
    """Features of this processor that numpy finds."""
    from numpy._core._multiarray_umath import __cpu_features__ as known

    return {name for name, there in known.items() if there}


SIMULATE = "import flexlab; flexlab.simulate('paper', 0.01)"
COMPILE_PATHS = "from flexlab.control.path import paths; [each.address for each in paths().values()]"
AT_ONCE = "import flexlab.compiled as compiled; compiled.A_MOMENT = 0.0; "
"""Announce even the shortest compilation, so that the load of the machine does not matter."""


def made_for(processor: str) -> dict[str, str]:
    """The environment of another processor's machine code, which is kept between runs of the tests.

    It is compiled once for each version of the kernels, as this processor's is: that takes a minute.
    """
    folder = user_cache() / "flexlab" / f"tests-{processor}"
    remove_unused(folder / "flexlab" / cache_folder().name)
    return {"NUMBA_CPU_NAME": processor, "NUMBA_CACHE_DIR": str(folder)}


def complete(*arguments: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, *arguments],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=True,
    )


def hashes(**environment: str) -> dict[str, str]:
    return json.loads(complete(str(RUNS), **environment).stdout)


@pytest.fixture(scope="module")
def here() -> dict[str, str]:
    return hashes()


def differing(here: dict[str, str], there: dict[str, str]) -> list[str]:
    assert here.keys() == there.keys()
    return [name for name in here if here[name] != there[name]]


@pytest.mark.skipif(not ON_X86, reason="these variables choose among kernels for x86-64")
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_libraries_for_another_processor_change_no_bit(name: str, here: dict[str, str]) -> None:
    if name == "SkylakeX" and "AVX512_SKX" not in features():
        pytest.skip("this processor has no AVX-512, which OpenBLAS's kernels for SkylakeX need")
    assert differing(here, hashes(**ENVIRONMENTS[name])) == []


@pytest.mark.skipif(
    not (ON_X86 and {"AVX2", "FMA3"} <= features()), reason="this processor cannot run code for haswell"
)
@pytest.mark.skipif(PLAIN_PYTHON, reason="nothing is compiled")
def test_machine_code_for_another_processor_changes_no_bit(here: dict[str, str]) -> None:
    assert differing(here, hashes(**made_for("haswell"))) == []


@pytest.mark.skipif(PLAIN_PYTHON, reason="nothing is compiled")
def test_compiling_is_announced_once(tmp_path: Path) -> None:
    """It is announced once for any number of kernels, and not at all if they are compiled already."""
    other = {"NUMBA_CPU_NAME": "generic", "NUMBA_CACHE_DIR": str(tmp_path)}
    said = complete("-c", AT_ONCE + COMPILE_PATHS, **other).stderr
    assert said.count("compiling the equations of motion") == said.count("\n") == 1
    assert complete("-c", AT_ONCE + COMPILE_PATHS, **other).stderr == ""


@pytest.mark.skipif(PLAIN_PYTHON, reason="nothing is compiled")
def test_a_cold_start_says_that_it_compiles(start_lab: Callable[..., Lab], tmp_path: Path) -> None:
    """What the lab has compiled is not compiled again for a simulation."""
    other = {"NUMBA_CPU_NAME": "generic", "NUMBA_CACHE_DIR": str(tmp_path / "cold")}
    (port,) = free_ports(1)
    lab = start_lab(port=port, **other)
    url = f"http://127.0.0.1:{port}/lab/"
    lab.wait(lambda: answer(url) == 503)
    lab.wait(lambda: "compiling the equations of motion" in "".join(lab.complained))
    lab.wait(lambda: answer(url) == 200)
    assert lab.url() == url
    assert lab.end() == 0
    assert complete("-c", AT_ONCE + SIMULATE, **other).stderr == ""
    (made,) = (tmp_path / "cold" / "flexlab").glob("kernels-*")
    kept = Path(made_for("generic")["NUMBA_CACHE_DIR"], "flexlab", made.name)
    if not kept.exists():  # What the lab has compiled is not compiled again for the next test, either.
        shutil.copytree(made, kept)


@pytest.mark.skipif(PLAIN_PYTHON, reason="nothing is compiled")
def test_machine_code_for_any_processor_changes_no_bit(here: dict[str, str]) -> None:
    assert differing(here, hashes(**made_for("generic"))) == []
