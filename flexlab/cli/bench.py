"""`flexlab bench`: how fast and how exact the engine is on this machine."""

from typing import Annotated

import tyro


def command(
    as_json: Annotated[
        bool, tyro.conf.arg(name="json", help="Print JSON instead of tables.", help_behavior_hint="")
    ] = False,
) -> None:
    """Measure speed and accuracy of the engine on this machine, on one core, after compiling."""
    from flexlab.studies.bench import run_bench

    run_bench(as_json=as_json)
