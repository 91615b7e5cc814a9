"""Paths given by numbers: a table from a CSV file, with a sentence for each way in which it can be wrong, and waypoints."""

from math import factorial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from flexlab.analysis.replay import replay
from flexlab.control.paths.waypoints import phases
from flexlab.errors import FlexlabError, PresetError, ScenarioError
from flexlab.presets import load_preset
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.scenario import Scenario, parse_scenario
from flexlab.scenario.path_file import read_path_file, with_path
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.simulate import simulate
from flexlab.sim.target import build_trajectory, desired_at
from flexlab.sim.world import World

TIMES = np.linspace(0.0, 1.0, 21)
ROWS = np.stack([TIMES, 0.1 * np.sin(3 * TIMES), 0.75 + 0.05 * TIMES**2, 0.2 * np.cos(2 * TIMES)], axis=1)


def write(file: Path, rows: np.ndarray = ROWS, header: str = "t [s], x [m], y [m], theta [rad]") -> Path:
    """Write rows into a CSV file, and return it."""
    np.savetxt(file, rows, delimiter=",", header=header, comments="", fmt="%.17g")
    return file


def on_table(**own: Any) -> Scenario:
    return load_preset("paper").replace({"trajectory": {"kind": "table", "rows": ROWS.tolist(), **own}})


def test_decimal_commas_are_read_where_they_separate_no_columns(tmp_path: Path) -> None:
    rows = "\nt [s];x [mm];y [m];theta [deg]\n0;0;0,75;0\n0,1;1,5;0,75;-2,5\n"
    (tmp_path / "comma.csv").write_text(rows, encoding="utf-8")
    (tmp_path / "point.csv").write_text(rows.replace(",", "."), encoding="utf-8")
    assert read_path_file(tmp_path / "comma.csv") == read_path_file(tmp_path / "point.csv")
    (tmp_path / "excel.csv").write_text(f"sep=;\n{rows}", encoding="utf-8-sig")
    assert read_path_file(tmp_path / "excel.csv") == read_path_file(tmp_path / "point.csv")


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_the_names_that_savetxt_writes_as_a_remark_are_read(tmp_path: Path, separator: str) -> None:
    names = separator.join(("t [s]", "x [m]", "y [m]", "theta [rad]"))
    np.savetxt(tmp_path / "path.csv", ROWS, delimiter=separator, header=f"Recorded on Monday\n{names}", fmt="%.17g")
    np.testing.assert_array_equal(read_path_file(tmp_path / "path.csv"), ROWS)


@pytest.mark.parametrize("ends", ["at rest", "free"])
def test_a_table_is_the_quintic_spline_through_its_rows(ends: str):
    motion = build_trajectory(on_table(ends=ends))
    rest = [(1, np.zeros(3)), (2, np.zeros(3))]
    spline = make_interp_spline(TIMES, ROWS[:, 1:], k=5, bc_type=(rest, rest) if ends == "at rest" else None)
    for t in np.linspace(0, 0.999, 173):
        for order, expected in enumerate(spline(t, nu=k) for k in range(3)):
            np.testing.assert_allclose(desired_at(motion, t)[order], expected, rtol=0, atol=1e-9)
    for row in ROWS:
        np.testing.assert_allclose(desired_at(motion, row[0])[0], row[1:], rtol=0, atol=1e-14)
    np.testing.assert_array_equal(desired_at(motion, 7.0), [ROWS[-1, 1:], [0] * 3, [0] * 3])


def test_a_table_with_free_ends_reproduces_a_smooth_motion_and_its_rates():
    motion = build_trajectory(on_table(ends="free"))
    found = np.array([desired_at(motion, t)[:, 0] for t in np.linspace(0, 0.99, 100)])
    angle = 3 * np.linspace(0, 0.99, 100)
    exact = np.stack([0.1 * np.sin(angle), 0.3 * np.cos(angle), -0.9 * np.sin(angle)], axis=1)
    assert np.all(np.abs(found - exact).max(axis=0) < (1e-7, 1e-5, 1e-3))


def test_a_path_from_a_file_is_followed_and_kept_in_the_recording(tmp_path: Path):
    scenario = with_path(load_preset("paper"), write(tmp_path / "path.csv"))
    assert scenario == on_table()
    run = simulate(scenario, 1.2)
    np.testing.assert_array_equal(run.desired_pose[-1], ROWS[-1, 1:])
    assert np.abs(run.tracking_error[-1]).max() < 1e-4
    (tmp_path / "path.csv").unlink()
    recording = read_recording(write_run(run, tmp_path, "table"))
    assert recording.scenario == scenario
    assert replay(recording).identical


def test_units_and_order_of_the_columns_are_those_of_the_header(tmp_path: Path):
    for angle, size in {"°": 180 / np.pi, "deg": 180 / np.pi, "mrad": 1e3}.items():
        other = np.stack([ROWS[:, 3] * size, 1e3 * ROWS[:, 0], 1e3 * ROWS[:, 1], 1e2 * ROWS[:, 2]], axis=1)
        file = write(tmp_path / "other.csv", other, f"θ ({angle}), Time (ms), X (mm), y (cm)")
        np.testing.assert_allclose(read_path_file(file), ROWS, rtol=1e-14, atol=1e-16)


WRONG = [
    ("t,x,y\n0,0,0\n1,0,0\n", "lacks the column theta: name the columns t [s], x [m], y [m], theta [rad]"),
    ("t,x,y,theta,z\n0,0,0,0,0\n", "'z' is not a column of a path"),
    ("t,x,x,theta\n0,0,0,0\n", "has the column x twice"),
    ("t [h],x,y,theta\n0,0,0,0\n", "'h' is not a unit of the column t: choose s, ms"),
    ("t,x [rad],y,theta\n0,0,0,0\n", "'rad' is not a unit of the column x: choose m, cm, mm"),
    ("t,x,y,theta\n0,0,0.75,0\n0.1,0,abc,0\n", "row 2 (line 3): y = 'abc' is not a finite number"),
    ("t,x,y,theta\n0,0,0.75,0\n0.1,nan,0.75,0\n", "row 2 (line 3): x = 'nan' is not a finite number"),
    ("t,x,y,theta\n0,0,0.75,0\n0.1,0,0.75\n", "row 2 (line 3) has 3 values, not 4"),
    ("t,x,y,theta\n0,0,0,75,0\n1,0,0,75,0\n", "row 1 (line 2) has 5 values, not 4"),
    ("t,x,y,theta\n0\n1,0,0.75,0\n", "row 1 (line 2) has 1 value, not 4"),
    ("t,x,y,theta\n" + 3_000_000 * "0,", "is too long: a path has 10000 rows at most"),
    ("t,x,y,theta\n0,0,0.75,0\n", "has 1 row below its header: a path needs 2 to 10000"),
    ("", "is empty"),
    ("# made by me\n0,0,0.75,0\n1,0,0.75,0\n", "'0' is not a column of a path: name the columns t [s], x [m]"),
    (
        "t,x,y,theta\n0,0,0.75,0\n0.2,0,0.75,0\n0.1,0,0.75,0\n",
        "row 3: t = 0.1 s does not come after the 0.2 s of row 2",
    ),
    ("t,x,y,theta\n-1,0,0.75,0\n0.2,0,0.75,0\n", "row 1: t = −1 s lies before the start"),
    (
        "t,x,y,theta\n" + "".join(f"{t},0,0.75,0\n" for t in (0, 0.1, 0.2, 0.3, 9.0)),
        "row 5: t jumps from 0.3 s to 9 s, more than 20 times the usual step",
    ),
]


@pytest.mark.parametrize(("text", "sentence"), WRONG, ids=[sentence[:40] for _, sentence in WRONG])
def test_a_wrong_file_gets_a_sentence(tmp_path: Path, text: str, sentence: str):
    (tmp_path / "path.csv").write_text(text)
    with pytest.raises(FlexlabError) as caught:
        with_path(load_preset("paper"), tmp_path / "path.csv")
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_missing_or_no_text_gets_a_sentence(tmp_path: Path):
    (tmp_path / "path.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PresetError, match="is not a text file in UTF-8"):
        read_path_file(tmp_path / "path.csv")
    with pytest.raises(PresetError, match=r"none\.csv cannot be read: No such file"):
        read_path_file(tmp_path / "none.csv")


def test_an_unreachable_row_is_named():
    rows = ROWS.copy()
    rows[13, 2] = 1.6
    text = World(on_table(rows=rows.tolist())).status.text
    assert "cannot reach the desired pose (" in text
    assert "between rows 13 and 14 of the table" in text or "row 14 of the table" in text
    alone = [[0, 0, 0.75, 0], [1, 0, 1.7, 0]]
    assert "of the table) at x = 0.000 m" in World(on_table(rows=alone)).status.text


def test_free_ends_need_six_rows():
    with pytest.raises(ScenarioError, match="with free ends a table needs 6 rows or more"):
        on_table(rows=ROWS[:5].tolist(), ends="free")


WAY = [[0.0, 0.65, 0.0], [0.1, 0.8, 0.2], [0.1, 0.8, 0.2], [-0.1, 0.8, -0.2]]


def on_waypoints(**own: Any) -> Scenario:
    return load_preset("paper").replace({"trajectory": {"kind": "waypoints", "points": WAY, **own}})


def test_waypoints_are_passed_at_rest_within_the_limits():
    limits = {"velocity_limit": (0.4, 0.5, 1.0), "acceleration_limit": 3.0, "jerk_limit": 60.0}
    scenario = on_waypoints(pause=0.1, start=0.2, **limits)
    path, motion = scenario.trajectory, build_trajectory(scenario)
    times = np.linspace(0, path.span + 0.1, 20_001)
    seen = np.array([desired_at(motion, t) for t in times])
    np.testing.assert_array_less(np.abs(seen[:, 1]).max(axis=0), np.add(limits["velocity_limit"], 1e-9))
    assert np.abs(seen[:, 2]).max() <= 3.0 + 1e-9
    assert np.abs(np.diff(seen[:, 2], axis=0)).max() <= 60.0 * (times[1] - times[0]) + 1e-9
    for point in WAY:
        near = np.argmin(np.abs(seen[:, 0] - point).sum(axis=1))
        np.testing.assert_allclose(seen[near], [point, [0] * 3, [0] * 3], rtol=0, atol=2e-3)
    # As fast as the limits allow: somewhere one of them is reached.
    assert np.abs(seen[:, 1] / limits["velocity_limit"]).max() > 0.99 or np.abs(seen[:, 2]).max() > 2.99
    # The first leg is a straight line.
    leg = (times > 0.2) & (seen[:, 0, 0] < 0.0999) & (seen[:, 0, 1] < 0.7999) & (times < 0.9)
    np.testing.assert_allclose(seen[leg, 0, 1] - 0.65, 1.5 * seen[leg, 0, 0], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(desired_at(motion, path.span + 5), [WAY[-1], [0] * 3, [0] * 3])


def test_a_single_waypoint_is_held():
    motion = build_trajectory(on_waypoints(points=[[0.05, 0.7, 0.1]]))
    np.testing.assert_array_equal(desired_at(motion, 3.0), [[0.05, 0.7, 0.1], [0] * 3, [0] * 3])
    assert phases(((0.0, 0.7, 0.0),), ((1.0,) * 3,) * 3, 0.1).shape == (1, 13)


@pytest.mark.parametrize(
    ("own", "sentence"),
    [
        ({"points": [[0.0, 0.7]]}, "needs 3 numbers"),
        ({"points": []}, "points"),
        ({"points": [[0.0, 170.0, 0.0]]}, "is outside the allowed range"),
        ({"jerk_limit": 0}, "jerk_limit = 0 m/s³, m/s³, rad/s³ is outside"),
    ],
)
def test_wrong_waypoints_get_a_sentence(own: dict, sentence: str):
    with pytest.raises(ScenarioError) as caught:
        on_waypoints(**own)
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    ("way", "limits"),
    [
        (0.02, (100.0, 1e4, 1e7)),
        (1.787684139221223e-6, (49.92545886405584, 1.6204633203573713, 11020.712272631958)),
        (3.4182120679935804e-5, (0.001560679267790638, 8.782551162653855, 63838.56501724204)),
        (2.152194863018043e-6, (15.434245122114445, 181.00422823082184, 2899169.845494693)),
    ],
)
def test_very_large_limits_are_reached_and_not_exceeded(way: float, limits: tuple[float, float, float]):
    """Each phase still ends where the next one begins, and the limit that determines the motion is reached."""
    triples = tuple((limit,) * 3 for limit in limits)
    rows = phases(((0.0, 0.7, 0.0), (0.0, 0.7 + way, 0.0)), triples, 0.0)
    times, y = np.diff(rows[:, 0]), rows[:, 2::3]  # y, its rate, acceleration and jerk
    for row, after, dt in zip(y[:-1], y[1:], times, strict=True):
        end = [sum(row[k + m] * dt**m / factorial(m) for m in range(4 - k)) for k in range(3)]
        scale = np.abs(y).max(axis=0)[:3] + [way, 0, 0]
        assert np.all(np.abs(end - after[:3]) <= 1e-9 * scale)
    used = np.abs(y).max(axis=0)[1:] / limits
    assert used.max() == pytest.approx(1.0, rel=1e-9)
    assert (used <= 1 + 1e-9).all()


def test_waypoints_are_replayed_and_changed_in_motion(tmp_path: Path):
    run = simulate(on_waypoints(), 0.4, commands=[(0.2, ChangeScenario({"trajectory.points": ((0.0, 0.7, 0.0),) * 2}))])
    assert run.status == "finished"
    assert np.abs(np.diff(run.desired_pose, axis=0)).max() < 2e-3
    recording = read_recording(write_run(simulate(on_waypoints(), 0.3), tmp_path, "way"))
    assert replay(recording).identical
    assert parse_scenario(on_waypoints().model_dump(mode="json")) == on_waypoints()


def test_the_command_line_follows_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    from flexlab.cli import main

    file = write(tmp_path / "path.csv")
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["run", "paper", "--duration", "0.01", "--logs", str(tmp_path), "--path", str(file)])
    recording = read_recording(next(tmp_path.glob("*.rrd")))
    assert recording.scenario.trajectory == on_table().trajectory
    (tmp_path / "empty.py").write_text("pass\n")
    for path, said in (
        ("none.csv", "cannot be read"),
        ("empty.py", "holds no path that can be used"),
        ("zigzag", "is not one of"),
    ):
        given = path if "." not in path else str(tmp_path / path)
        with pytest.raises(SystemExit, match=r"^2$"):
            main(["run", "paper", "--path", given, "--logs", str(tmp_path)])
        assert said in " ".join(capsys.readouterr().err.split())
