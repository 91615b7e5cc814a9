"""flexlab: two planar arms carry a flexible beam, simulated, controlled, seen live and recorded."""

from typing import Any

__version__ = "0.1.0"

_HOMES = {
    "load_preset": "flexlab.presets",
    "preset_names": "flexlab.presets",
    "Scenario": "flexlab.scenario",
    "parse_scenario": "flexlab.scenario",
    "simulate": "flexlab.sim.simulate",
    "simulate_many": "flexlab.analysis.batch",
    "modes": "flexlab.analysis.modes",
    "Run": "flexlab.sim.samples",
}
"""Public names and the modules they live in; imported on first use, so that `flexlab --help` need not load numba."""

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'flexlab' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)
