"""The wheel is complete: presets and web assets are inside and found, and nothing else of the checkout is."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from flexlab.assets import data_folder, presets_folder, web_assets_folder


@pytest.fixture(scope="module")
def wheel(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir"]
    subprocess.run([*build, str(folder), str(root)], check=True, stdin=subprocess.DEVNULL)
    (file,) = folder.glob("flexlab-*-py3-none-any.whl")
    return file


def files_below(folder: Path) -> set[str]:
    """Return the files in a folder, without the bytecode that Python writes there when a test builds the documentation."""
    paths = (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {str(path.relative_to(folder)) for path in paths}


@pytest.mark.parametrize("name", ["presets", "web_assets"])
def test_the_data_folders_are_inside(wheel: Path, root: Path, name: str):
    prefix = f"flexlab/_data/{name}/"
    with zipfile.ZipFile(wheel) as archive:
        inside = {file.removeprefix(prefix) for file in archive.namelist() if file.startswith(prefix)}
    assert inside == files_below(root / name)
    assert inside


def test_nothing_else_is_inside(wheel: Path):
    with zipfile.ZipFile(wheel) as archive:
        tops = {file.split("/")[0] for file in archive.namelist()}
    assert tops == {"flexlab", next(top for top in tops if top.endswith(".dist-info"))}


def test_an_installed_wheel_finds_its_data(wheel: Path, tmp_path: Path):
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    program = "import flexlab.presets as p, flexlab.assets as a; print(len(p.preset_names()), a.web_assets_folder())"
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path / "site")},
        capture_output=True,
        text=True,
        check=True,
    )
    count, folder = done.stdout.split(maxsplit=1)
    assert int(count) == len(list(presets_folder().glob("*.json")))
    assert Path(folder.strip()) == tmp_path / "site" / "flexlab" / "_data" / "web_assets"


def test_a_checkout_finds_its_data(root: Path):
    assert presets_folder() == root / "presets"
    assert web_assets_folder() == root / "web_assets"
    with pytest.raises(FileNotFoundError, match="nothing"):
        data_folder("nothing")
