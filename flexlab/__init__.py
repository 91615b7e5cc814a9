"""flexlab: two planar arms carry a flexible beam, simulated, controlled, seen live and recorded."""

__version__ = "0.3.0"

with open(f"{__file__}i", encoding="utf-8") as _stub:
    _HOMES = {line.split()[-1]: line.split()[1] for line in _stub if line.startswith("from ")}
"""Public names and the modules they live in; imported on first use, so that `flexlab --help` need not load numba."""

__all__ = ["__version__", *sorted(_HOMES)]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'flexlab' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
