"""`flexlab bench`: how fast and how exact the engine is on this machine."""

from typing import Annotated

import tyro


def command(
    as_json: Annotated[
        bool, tyro.conf.arg(name="json", help="Print one JSON object instead of tables.", help_behavior_hint="")
    ] = False,
    quick: Annotated[
        bool, tyro.conf.arg(help="Measure less: half a minute instead of two.", help_behavior_hint="")
    ] = False,
    peers: Annotated[
        bool,
        tyro.conf.arg(
            help="Compare with MuJoCo and Exudyn as well (needs flexlab[peers] installed).", help_behavior_hint=""
        ),
    ] = False,
) -> None:
    """Measure speed and accuracy of the engine on this machine, on one core, after compiling."""
    from flexlab.benchmarks import run_bench
    from flexlab.cli.warmup import warm_up
    from flexlab.presets import load_preset

    warm_up(load_preset("paper"))
    run_bench(as_json=as_json, quick=quick, peers=peers)
