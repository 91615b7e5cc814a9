"""`flexlab bench`: measure speed and accuracy on this machine."""

import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from flexlab.cli.options import option
from flexlab.cli.warmup import loading, warm_up

if TYPE_CHECKING:
    from types import ModuleType


def command(
    as_json: Annotated[bool, option("Print one JSON object instead of tables.", name="json")] = False,
    quick: Annotated[bool, option("Measure less, and no cold start: a minute or two instead of several.")] = False,
    peers: Annotated[
        bool,
        option("Compare with MuJoCo and Exudyn as well (in a checkout of flexlab, with flexlab[peers] installed)."),
    ] = False,
) -> None:
    """Measure speed and accuracy of the engine on this machine, on one core, after compiling."""
    with loading():
        from flexlab.benchmarks import run_bench
        from flexlab.presets import load_preset

    compared = _peers() if peers else None
    warm_up(load_preset("paper"))
    run_bench(as_json=as_json, quick=quick, peers=compared)


def _peers() -> "ModuleType":
    """Import the package of other engines from the folder of tests. Raises `StudyError` outside a checkout."""
    from flexlab.errors import StudyError

    beside = Path(__file__).resolve().parents[2] / "tests"
    if not (beside / "peers").is_dir():
        raise StudyError(
            "--peers needs a checkout of flexlab, whose folder tests/peers has the other engines: this installation lacks it."
        )
    sys.path.append(str(beside))
    return import_module("peers")
