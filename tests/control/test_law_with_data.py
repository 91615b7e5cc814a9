"""A law that reads a data file: its recordings contain the data, and a file that cannot be kept is refused."""

import importlib.util
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lab_process import Command
from own_law_text import allow_no_own_laws

import flexlab
from flexlab.errors import FlexlabError, ScenarioError
from flexlab.own.reading import MOST_DATA, with_data, without_data
from flexlab.recording.importing import import_into
from flexlab.recording.reader import read_recording

TEXT = '''"""Gains from a file."""

import numpy as np

from flexlab import OwnLaw, data_file

P, D = np.load(data_file("gains.npy"))  # "ä"


class FiledGains(OwnLaw):
    """PD with the gains of a file."""

    def act(self, at):
        error, rate = at.pose - at.desired_pose, at.pose_rate - at.desired_rate
        return at.weights + at.shared(-P * error - D * rate)
'''


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The file of the law, in one folder with the file of its gains."""
    np.save(tmp_path / "gains.npy", np.array([20000.0, 800.0]))
    law = tmp_path / "filed_gains.py"
    law.write_text(TEXT, encoding="utf-8")
    return law


def test_its_recording_replays_without_its_files(file: Path, flexlab_command: Command):
    run = flexlab.simulate("paper", 0.2, law=file)
    sampled = flexlab.load_preset("paper").replace({"controller": {"kind": "pd", "control_period": 0.001}})
    np.testing.assert_allclose(run.pose, flexlab.simulate(sampled, 0.2).pose, rtol=0, atol=1e-9)
    kept = run.save(file.parent / "kept.rrd")
    for beside in (file, file.with_name("gains.npy")):
        beside.unlink()
    assert flexlab.replay(kept).agrees
    allow_no_own_laws()
    asked = flexlab_command("replay", str(kept)).stderr
    assert f'data_file("gains.npy", "{128 + 2 * 8} bytes")' in asked
    assert "give --run-own-law to let it run" in asked


def test_a_class_may_read_the_data_file_too(file: Path, monkeypatch: pytest.MonkeyPatch):
    about = importlib.util.spec_from_file_location("filed_gains", file)
    assert about is not None
    assert about.loader is not None
    module = importlib.util.module_from_spec(about)
    monkeypatch.setitem(sys.modules, "filed_gains", module)
    about.loader.exec_module(module)
    by_class = flexlab.simulate("paper", 0.05, law=module.FiledGains)
    np.testing.assert_array_equal(by_class.pose, flexlab.simulate("paper", 0.05, law=file).pose)


def test_other_data_make_another_law(file: Path):
    """The second run takes the new gains, although the file of the law is the same."""
    first = flexlab.simulate("paper", 0.05, law=file)
    np.save(file.with_name("gains.npy"), np.array([10000.0, 400.0]))
    assert np.abs(flexlab.simulate("paper", 0.05, law=file).pose - first.pose).max() > 1e-5


@pytest.mark.parametrize(
    ("call", "says"),
    [
        ('data_file("none.npy")', r"Line 2: data_file\('none.npy'\): there is no such file"),
        ('data_file("../gains.npy")', "give the name of a file in the same folder"),
        ('data_file("/etc/passwd")', "give the name of a file in the same folder"),
        ('data_file("")', "give the name of a file in the same folder"),
        ('data_file("link.npy")', "give the name of a file in the same folder"),
        ("data_file(NAME)", "data_file needs the name of a file, written out"),
        ('data_file("large.bin")', rf"it has {MOST_DATA + 1} bytes, {MOST_DATA} are the most"),
    ],
)
def test_a_data_file_that_cannot_be_kept_is_refused(file: Path, call: str, says: str):
    file.with_name("link.npy").symlink_to("/etc/hostname")
    file.with_name("large.bin").write_bytes(bytes(MOST_DATA + 1))
    file.write_text(TEXT.replace("import numpy", f"X = {call}\nimport numpy", 1).replace("from a file", "X"), "utf-8")
    with pytest.raises(FlexlabError, match=says.replace("Line 2", "Line 3")):
        flexlab.simulate("paper", 0.05, law=file)


def test_embedding_the_data_keeps_the_line_numbers_of_a_text(file: Path):
    whole = with_data(TEXT, file.parent, "controller.source")
    assert [line[:30] for line in whole.split("\n")] == [line[:30] for line in TEXT.split("\n")]
    assert with_data(whole, Path("nowhere"), "controller.source") == whole
    assert without_data(whole).count("\n") == TEXT.count("\n")
    (file.parent / "gains.npy").write_bytes(b"")
    emptied: dict[str, Any] = {}
    exec(
        with_data('from flexlab import data_file\nleft = data_file("gains.npy").read()', file.parent, "source"), emptied
    )
    assert emptied["left"] == b"", "an empty file is kept, too"
    with pytest.raises(ScenarioError, match="there is no such file in nowhere"):
        with_data(TEXT, Path("nowhere"), "controller.source")


HELPED = TEXT.replace("P, D = np.load", "from scaling import scaled\n\nP, D = scaled(np.load").replace('"))', '")))')
SCALING = """import numba
from factors import FACTOR


@numba.njit(cache=True)
def scaled(gains):
    return FACTOR * gains
"""


def test_its_recording_replays_without_the_modules_beside_it(
    file: Path, flexlab_command: Command, flexlab_process: Command
):
    """Machine code that numba kept was not found without the files, and could not be loaded with them."""
    file.write_text(HELPED, encoding="utf-8")
    beside = [file, *(file.with_name(name) for name in ("scaling.py", "factors.py", "gains.npy"))]
    beside[1].write_text(SCALING, encoding="utf-8")
    beside[2].write_text("FACTOR = 1.0\n", encoding="utf-8")
    run = flexlab.simulate("paper", 0.05, law=file)
    kept = run.save(file.parent / "kept.rrd")
    for one in beside:
        one.unlink()
    done = flexlab_process("replay", str(kept), "--run-own-law")
    assert done.returncode == 0, done.stdout + done.stderr
    allow_no_own_laws()
    assert "return FACTOR * gains" in flexlab_command("replay", str(kept)).stderr  # All is shown before it runs.


def test_other_modules_make_another_law(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A sweep gave the numbers of the former module, and so did a law in another folder with a module of the same name.

    So would machine code that numba keeps by the file of a function, as `FACTOR` is a constant in it.
    """
    monkeypatch.chdir(tmp_path)
    found = []
    for folder, factor in (("one", 1.0), ("one", 0.5), ("two", 0.25)):
        place = tmp_path / folder
        place.mkdir(exist_ok=True)
        (place / "gains.npy").write_bytes((tmp_path / "gains.npy").read_bytes())
        (place / "filed_gains.py").write_text(HELPED, encoding="utf-8")
        (place / "scaling.py").write_text(SCALING, encoding="utf-8")
        (place / "factors.py").write_text(f"FACTOR = {factor}\n", encoding="utf-8")
        law = place / "filed_gains.py"
        swept = flexlab.sweep("paper", {"gravity": [0.0]}, 0.05, accuracy=None, law=law)
        error = swept.table["rms_error.x"][0].as_py()
        assert error == flexlab.simulate("paper", 0.05, law=law).metrics["rms_error.x"]
        assert error not in found
        found.append(error)


def test_a_module_beside_it_that_is_no_text_is_refused(file: Path):
    file.write_text(HELPED, encoding="utf-8")
    file.with_name("scaling.py").write_bytes(b"\xff")
    with pytest.raises(ScenarioError, match=r"scaling\.py cannot be read: it is not text in UTF-8\."):
        flexlab.simulate("paper", 0.05, law=file)


def test_a_recording_holds_the_versions_of_packages_that_the_law_imports(
    file: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    """Also of those that its modules import, and a replay with other versions says so, although its samples are the same."""
    site = tmp_path / "site"
    (about := site / "gainbook-1.0.dist-info").mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: gainbook\nVersion: 1.0\n")
    (site / "gainbook.py").write_text("FACTOR = 1.0\n")
    monkeypatch.syspath_prepend(site)
    (tmp_path / "scaling.py").write_text("import json\nimport gainbook\nFACTOR = gainbook.FACTOR\n")
    file.write_text(TEXT.replace("P, D =", "from scaling import FACTOR\n\nP, D =").replace("-P *", "-P * FACTOR *"))
    kept = flexlab.simulate("paper", 0.05, law=file).save(tmp_path / "kept.rrd")
    packages = json.loads(read_recording(kept).properties["packages"])
    assert packages == {"numpy": np.__version__, "gainbook": "1.0"}
    again = flexlab.replay(kept)
    assert again.agrees
    assert "imports" not in again.text
    archive = flexlab.export(kept, tmp_path / "kept.zip")
    table = import_into(flexlab.export(kept, tmp_path / "kept.csv"), tmp_path / "logs")
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: gainbook\nVersion: 2.0\n")
    for source in (kept, archive, table):
        again = flexlab.replay(source)
        assert again.agrees
        assert again.text.endswith(" The control law imports packages of other versions: gainbook 1.0 then, 2.0 now.")
