"""flexlab: two planar arms carry a flexible beam, simulated, controlled, seen live and recorded."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flexlab.analysis.comparison import Comparison
    from flexlab.analysis.explanations import Explained
    from flexlab.analysis.identification.fitting import Fit
    from flexlab.analysis.internal_force import internal_force_eq_26
    from flexlab.analysis.leaderboard.board import Leaderboard
    from flexlab.analysis.linear_model import LinearModel
    from flexlab.analysis.metrics import RunMetrics
    from flexlab.analysis.metrics.own import metric
    from flexlab.analysis.modes import Modes
    from flexlab.analysis.replay import Replay
    from flexlab.analysis.result import Result
    from flexlab.analysis.sweep.result import Sweep
    from flexlab.analysis.tuning import Tuning
    from flexlab.analysis.validation import Validation
    from flexlab.api import Run, explain, export_fmu, modes, read, simulate, simulate_many, sweep
    from flexlab.leaderboard_api import leaderboard
    from flexlab.linear_api import linearize
    from flexlab.notebook import Lab
    from flexlab.own.declaration import OwnLaw, OwnPath, gain, memory, option, readout
    from flexlab.own.measurement import Measurement
    from flexlab.presets import load_preset, preset_names
    from flexlab.scenario import Scenario, parse_scenario
    from flexlab.sim.samples import Samples
    from flexlab.study_api import compare, export, fit, replay, tune, validate

__version__ = "0.2.0"

_HOMES = {
    "load_preset": "flexlab.presets",
    "preset_names": "flexlab.presets",
    "Scenario": "flexlab.scenario",
    "parse_scenario": "flexlab.scenario",
    "simulate": "flexlab.api",
    "simulate_many": "flexlab.api",
    "read": "flexlab.api",
    "sweep": "flexlab.api",
    "leaderboard": "flexlab.leaderboard_api",
    "Leaderboard": "flexlab.analysis.leaderboard.board",
    "Lab": "flexlab.notebook",
    "Sweep": "flexlab.analysis.sweep.result",
    "Run": "flexlab.api",
    "RunMetrics": "flexlab.analysis.metrics",
    "explain": "flexlab.api",
    "Explained": "flexlab.analysis.explanations",
    "export_fmu": "flexlab.api",
    "modes": "flexlab.api",
    "Modes": "flexlab.analysis.modes",
    "internal_force_eq_26": "flexlab.analysis.internal_force",
    "linearize": "flexlab.linear_api",
    "LinearModel": "flexlab.analysis.linear_model",
    "OwnLaw": "flexlab.own.declaration",
    "gain": "flexlab.own.declaration",
    "memory": "flexlab.own.declaration",
    "readout": "flexlab.own.declaration",
    "OwnPath": "flexlab.own.declaration",
    "Measurement": "flexlab.own.measurement",
    "option": "flexlab.own.declaration",
    "Samples": "flexlab.sim.samples",
    "metric": "flexlab.analysis.metrics.own",
    "tune": "flexlab.study_api",
    "Tuning": "flexlab.analysis.tuning",
    "fit": "flexlab.study_api",
    "Fit": "flexlab.analysis.identification.fitting",
    "compare": "flexlab.study_api",
    "Comparison": "flexlab.analysis.comparison",
    "replay": "flexlab.study_api",
    "Replay": "flexlab.analysis.replay",
    "Result": "flexlab.analysis.result",
    "export": "flexlab.study_api",
    "validate": "flexlab.study_api",
    "Validation": "flexlab.analysis.validation",
}
"""Public names and the modules they live in; imported on first use, so that `flexlab --help` need not load numba."""

__all__ = [
    "Comparison",
    "Explained",
    "Fit",
    "Lab",
    "Leaderboard",
    "LinearModel",
    "Measurement",
    "Modes",
    "OwnLaw",
    "OwnPath",
    "Replay",
    "Result",
    "Run",
    "RunMetrics",
    "Samples",
    "Scenario",
    "Sweep",
    "Tuning",
    "Validation",
    "__version__",
    "compare",
    "explain",
    "export",
    "export_fmu",
    "fit",
    "gain",
    "internal_force_eq_26",
    "leaderboard",
    "linearize",
    "load_preset",
    "memory",
    "metric",
    "modes",
    "option",
    "parse_scenario",
    "preset_names",
    "read",
    "readout",
    "replay",
    "simulate",
    "simulate_many",
    "sweep",
    "tune",
    "validate",
]
"""The same names, written out for type checkers (a test compares)."""


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'flexlab' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
