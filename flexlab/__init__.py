"""flexlab: two planar arms carry a flexible beam, simulated, controlled, seen live and recorded."""

__version__ = "0.3.0"

with open(f"{__file__}i", encoding="utf-8") as _stub:
    _HOMES = {line.split()[-1]: line.split()[1] for line in _stub if line.startswith("from ")}
"""Public names and the modules they live in; imported on first use, so that `flexlab --help` need not load numba."""

__all__ = ["__version__", *sorted(_HOMES)]

_EARLIER = {"own_laws": "flexlab.Measurement and flexlab.OwnLaw", "own_paths": "flexlab.OwnPath"}
"""Packages of version 0.2.0, and the names that replace what they held."""


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        now = f": since 0.3.0 take {_EARLIER[name]}" if name in _EARLIER else ""
        raise AttributeError(f"module 'flexlab' has no attribute {name!r}{now}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
