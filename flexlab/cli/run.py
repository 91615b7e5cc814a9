"""`flexlab run`: a simulation without a screen."""

from typing import Annotated

import tyro

from flexlab.cli.options import LOGS, Logs, Preset


def command(
    preset: tyro.conf.Positional[Preset],
    duration: Annotated[float, tyro.conf.arg(metavar="S", help="Simulated time, s.")] = 3.0,
    sample_period: Annotated[float, tyro.conf.arg(metavar="S", help="Time between samples, s.")] = 0.001,
    logs: Logs = LOGS,
) -> int:
    """Simulate PRESET without a screen, as fast as the machine can, record it and print a summary."""
    raise NotImplementedError
