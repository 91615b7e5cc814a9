"""One idea, one file: laws and paths are found by looking into their folders, not listed anywhere."""

import hashlib
import importlib
import importlib.util
import pkgutil
import sys
from pathlib import Path
from types import ModuleType


def modules_in(package: str) -> list[ModuleType]:
    """Every module of a package's folder, imported, by name."""
    folder = importlib.import_module(package)
    names = sorted(module.name for module in pkgutil.iter_modules(folder.__path__))
    return [importlib.import_module(f"{package}.{name}") for name in names]


def module_from_file(path: Path) -> ModuleType:
    """A Python file outside the package as a module. Raises what the file raises, and ImportError if it cannot be read."""
    # A name that another process gives it as well: machine code kept from an earlier one asks for its module by name.
    name = f"flexlab_file_{path.stem}_{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is not a Python file: give a file whose name ends in .py.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
