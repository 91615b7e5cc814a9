"""Exports are read again bit for bit by flexlab, and by other programs under plain column names."""

import csv
import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
import pytest
from exported import export_run
from recording_helpers import assert_same_bits

from flexlab.errors import RecordingError
from flexlab.presets import load_preset
from flexlab.recording.export import FORMATS, export_recording, import_run
from flexlab.recording.headless import HeadlessRecording
from flexlab.recording.reader import read_recording
from flexlab.recording.run_info import RunInfo
from flexlab.recording.table_columns import table_columns
from flexlab.scenario import Scenario
from flexlab.scenario.payload import FIXED_COORDINATES
from flexlab.sim.commands import Tap
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate
from flexlab.sim.snapshot import Event

EVERY_FORMAT = pytest.mark.parametrize("suffix", FORMATS)


@EVERY_FORMAT
@pytest.mark.parametrize("preset", ["paper", "single-arm"])
def test_an_import_equals_the_original_bit_for_bit(suffix: str, preset: str, tmp_path: Path) -> None:
    run = simulate(load_preset(preset), duration=0.2)
    found, metadata = import_run(export_run(run, tmp_path / f"run{suffix}"))
    assert_same_bits(found, run)
    assert found.scenario == run.scenario
    assert (found.status, found.status.text) == (run.status, run.status.text)
    assert metadata["seed"] == run.scenario.controller.sensor_noise.seed
    assert metadata["flexlab_version"]


@EVERY_FORMAT
def test_a_recording_is_exported_with_its_commands(suffix: str, run: Run, tmp_path: Path) -> None:
    with HeadlessRecording(tmp_path, RunInfo("paper", run.scenario)) as recording:
        recording.write(run)
        recording.note(Event(0.3, "tap", Tap(0.1, (0.2, 0.3))))
        recording.end(run.status)
    original = read_recording(recording.path)
    found, metadata = import_run(export_recording(original, tmp_path / f"x{suffix}", 0.25, 0.75))
    assert_same_bits(found, run.slice(250, 751))
    assert metadata["preset"] == "paper"
    tap = {"kind": "Tap", "beam_position": 0.1, "impulse": [0.2, 0.3]}
    assert metadata["events"][0] == {"time": 0.3, "text": "tap", "level": "info", "command": tap}


def test_column_names_say_the_signal_the_part_and_the_unit(run: Run, tmp_path: Path) -> None:
    path = export_run(run, tmp_path / "run.csv")
    with path.open(encoding="utf-8") as file:
        about = json.loads(file.readline().removeprefix("# "))
        rows = list(csv.DictReader(file))
    assert about["scenario"]["payload"]["bending_stiffness"] == 100.0
    assert float(rows[7]["joint_torque_left_2 [N·m]"]) == run.joint_torque[7, 0, 1]
    assert float(rows[7]["beam_coordinates_node1_deflection [m]"]) == run.midspan_deflection[7]
    assert float(rows[7]["internal_force_right_theta [N·m]"]) == run.internal_force[7, 1, 2]
    assert float(rows[7]["time [s]"]) == 0.007


def test_other_programs_can_read_parquet_and_npz(run: Run, tmp_path: Path) -> None:
    table = parquet.read_table(export_run(run, tmp_path / "run.parquet"))
    np.testing.assert_array_equal(table.column("tracking_error_y [m]").to_numpy(), run.tracking_error[:, 1])
    with np.load(export_run(run, tmp_path / "run.npz")) as file:
        np.testing.assert_array_equal(file["bound_estimates_2 [N·s²/m²]"], run.bound_estimates[:, 2])


@pytest.mark.parametrize("boundary", FIXED_COORDINATES)
@pytest.mark.parametrize("elements", [2, 5])
def test_every_mesh_has_as_many_columns_as_coordinates(boundary: str, elements: int) -> None:
    data = Scenario().model_dump()
    data["payload"] |= {"boundary": boundary, "element_count": elements}
    if boundary == "clamped-free":
        data["right_arm"] = None
    scenario = Scenario.model_validate(data)
    columns = [column for column in table_columns(scenario) if column.signal == "beam_coordinates"]
    assert len(columns) == scenario.payload.coordinate_count
    assert len({column.name for column in table_columns(scenario)}) == len(table_columns(scenario))


@EVERY_FORMAT
@pytest.mark.parametrize("content", [b"", b"time\n1\n", b"# {}\ntime [s]\n1\n", b"PAR1nonsensePAR1"])
def test_other_files_are_refused_in_one_sentence(suffix: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"other{suffix}"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="is not a run exported by flexlab") as caught:
        import_run(path)
    assert "\n" not in str(caught.value)


def test_what_cannot_be_exported_or_imported_is_refused_with_a_reason(run: Run, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"no known format: let its name end in \.csv, \.parquet, \.npz"):
        export_run(run, tmp_path / "run.xlsx")
    with pytest.raises(RecordingError, match="From 5 to 6 s there is no sample: choose times within 0 to 1 s"):
        export_run(run, tmp_path / "run.csv", 5, 6)
    with pytest.raises(RecordingError, match=r"From 0\.9 to 0\.1 s there is no sample"):
        export_run(run, tmp_path / "run.csv", 0.9, 0.1)
    with pytest.raises(RecordingError, match="cannot be written"):
        export_run(run, tmp_path / "no" / "such" / "run.csv")
    with pytest.raises(RecordingError, match="There is no file"):
        import_run(tmp_path / "no.csv")
    assert list(tmp_path.iterdir()) == []
