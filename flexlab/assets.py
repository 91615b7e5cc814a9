"""Finds the data files that belong to flexlab: `presets/` and `web_assets/`.

In a source checkout they are folders beside the package; in an installed wheel they are inside it, under `_data`.
"""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def data_folder(name: str) -> Path:
    """The folder `name` ("presets" or "web_assets"). Raises FileNotFoundError if the installation lacks it."""
    for folder in (_PACKAGE / "_data" / name, _PACKAGE.parent / name):
        if folder.is_dir():
            return folder
    raise FileNotFoundError(f"This installation of flexlab has no folder {name}: install flexlab again.")


def presets_folder() -> Path:
    """Where the presets of flexlab itself lie (scenario files)."""
    return data_folder("presets")


def web_assets_folder() -> Path:
    """Where models, pictures and the guide of the lab lie."""
    return data_folder("web_assets")
