"""Wrong arguments of Python functions are refused in one sentence that names the argument; only True counts as a yes."""

import contextlib
import math
import pydoc
import re
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from fractions import Fraction
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import flexlab
from flexlab.errors import FlexlabError, ScenarioError, StudyError
from flexlab.sim.commands import Pull, Tap

EI = "payload.bending_stiffness"
NO_PATH = [None, 5, b"x", "", "a\0b", "\ud800", Path("\0"), [Path("x")], object()]
NO_TIME = ["0", b"0", math.nan, math.inf, 10**400, 1j, np.complex128(1), [], {}, np.zeros(2), True, object()]
NO_FLAG = [None, "no", 0, 1, [], np.zeros(2), math.nan, object()]
NO_TEXT = ["", 5, True, b"vibration", ["vibration"], {}, np.zeros(2), object()]


@pytest.fixture(scope="module", name="run")
def short_run() -> flexlab.Run:
    """A run of 0.02 s."""
    return flexlab.simulate("paper", 0.02)


def one_sentence(ask: Callable[[], object], *says: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(FlexlabError) as caught:
            ask()
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert sentence.endswith(".")
    assert len(sentence) < 500
    for part in says:
        assert part in sentence, sentence


@pytest.mark.parametrize("given", NO_PATH)
def test_a_folder_or_file_must_be_a_path(run: flexlab.Run, given: Any, tmp_path: Path):
    one_sentence(lambda: flexlab.compare(run, "newest", logs=given), "logs = ", "is not a path")
    one_sentence(lambda: flexlab.replay("newest", logs=given), "logs = ", "is not a path")
    one_sentence(lambda: flexlab.fit("newest", logs=given), "logs = ", "is not a path")
    one_sentence(lambda: flexlab.read("newest", logs=given), "logs = ", "is not a path")
    one_sentence(lambda: flexlab.export("newest", tmp_path / "a.csv", logs=given), "logs = ", "is not a path")
    one_sentence(lambda: flexlab.export(run, given), "to = ", "is not a path")
    one_sentence(lambda: run.save(given), "folder = ", "is not a path")


@pytest.mark.parametrize("file", ["a\0.py", "a\0.csv", "a\0.fmu", "\ud800.py", "\ud800.csv"])
def test_an_impossible_file_name_is_refused(file: str):
    asked: list[Callable[[], object]] = [lambda: flexlab.simulate("paper", 0.01, path=file)]
    if not file.endswith(".csv"):
        asked += [lambda: flexlab.simulate("paper", 0.01, law=file)]
    for ask in [*asked, lambda: flexlab.simulate("paper", 0.01, path=Path(file))]:
        one_sentence(ask)


@pytest.mark.parametrize(
    "given", [f"{150 * 'ü'}.{kind}" for kind in ("csv", "rrd", "json")] + ["a\0.csv", "\ud800.csv"]
)
def test_a_name_that_no_file_can_have_is_refused(run: flexlab.Run, given: str):
    one_sentence(lambda: run.save(given))
    one_sentence(lambda: flexlab.fit(given))


def test_a_measurement_to_fit_must_be_a_run_or_a_file(run: flexlab.Run):
    """A long dictionary was taken for a file whose name is too long."""
    one_sentence(lambda: flexlab.fit(run.scenario.model_dump()), "is not a run")  # type: ignore[arg-type]


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("value", [1.7e308, np.inf])
@pytest.mark.parametrize("name", ["pose", "tracking_error", "midspan_deflection", "beam_coordinates", "internal_force"])
def test_a_run_with_values_beyond_all_measure_raises_no_warning(name: str, value: float, tmp_path: Path):
    """Imported runs may hold such values; under `python -W error` each of these calls failed."""
    whole = flexlab.simulate("paper", 1.0)
    odd = whole[name].copy()
    odd[700::2], odd[701::2] = value, -value
    run = flexlab.Run(**{**whole.signals(), name: odd}, scenario=whole.scenario, status=whole.status)
    print(run.metrics, *run.explanations)
    run.save(tmp_path)
    flexlab.export(run, tmp_path / "run.html")
    with contextlib.suppress(flexlab.FlexlabError):
        flexlab.fit(run)


@pytest.mark.parametrize("given", NO_TIME)
def test_a_time_must_be_a_finite_number(run: flexlab.Run, given: Any, tmp_path: Path):
    for name in ("start", "end"):
        one_sentence(lambda name=name: flexlab.export(run, tmp_path / "a.csv", **{name: given}), f"{name} = ", " s is")
        one_sentence(lambda name=name: flexlab.fit(run, **{name: given}), f"{name} = ", " s is not usable")
    one_sentence(lambda: flexlab.simulate("paper", given), "duration = ", " s is not usable")
    one_sentence(lambda: flexlab.simulate("paper", 0.01, given), "sample_period = ", " s is not usable")
    one_sentence(lambda: flexlab.sweep("paper", {EI: [50.0]}, given), "duration = ", " s is not usable")
    one_sentence(lambda: flexlab.sweep("paper", {EI: [50.0]}, accuracy=given), "accuracy = ", " m is not usable")


@pytest.mark.parametrize("duration", [1e300, 1e308, 10**300])
def test_a_duration_too_long_for_the_memory_is_refused(duration: float):
    one_sentence(lambda: flexlab.simulate("paper", duration), "samples, over", "choose a shorter duration")


def test_a_duration_and_a_period_may_be_fractions():
    run = flexlab.simulate("paper", Fraction(1, 50), Fraction(1, 1000))
    assert run.result_hash == flexlab.simulate("paper", 0.02).result_hash


@pytest.mark.parametrize("accuracy", [-1.0, -1e-9])
def test_a_negative_accuracy_is_refused(accuracy: float):
    one_sentence(lambda: flexlab.sweep("paper", {EI: [50.0]}, accuracy=accuracy), "accuracy = -1", "of at least 0")


@pytest.mark.parametrize("given", NO_FLAG)
def test_a_flag_must_be_true_or_false(run: flexlab.Run, given: Any):
    asked: dict[str, Callable[[], object]] = {
        "check": lambda: flexlab.simulate("paper", 0.01, check=given),
        "progress": lambda: flexlab.simulate_many(["paper"], 0.01, progress=given),
        "run_own_law": lambda: flexlab.replay("newest", run_own_law=given),
        "long": lambda: flexlab.leaderboard(["pd"], ["B1"], long=given),
    }
    if given is not None:  # The inputs then decide.
        asked["closed"] = lambda: flexlab.linearize("paper", closed=given)
    for name, ask in asked.items():
        one_sentence(ask, f"{name} = ", "give True or False")


@pytest.mark.parametrize("given", NO_TEXT)
def test_a_signal_must_be_a_name(run: flexlab.Run, given: Any):
    one_sentence(lambda: flexlab.fit(run, signal=given), "signal = ", "give a text")
    one_sentence(lambda: flexlab.fit(run, time=given), "time = ", "give a text")


@pytest.mark.parametrize("given", [None, 5, b"x", ["newest"], np.zeros((3, 2)), pd.DataFrame({"t": [0, 1]}), object()])
def test_a_run_must_be_a_run_or_a_recording(run: flexlab.Run, given: Any):
    """A table with two columns was answered with: There is no recording t w 0 0 1."""
    for ask in (lambda: flexlab.fit(given), lambda: flexlab.compare(run, given), lambda: flexlab.replay(given)):
        one_sentence(ask, "is not a run: give one from flexlab.simulate, or the name or path of a recording")


@pytest.mark.parametrize("given", [None, 5, b"x", 1.5, ("payload",), object()])
def test_a_field_must_be_a_name(given: Any):
    scenario = flexlab.load_preset("paper")
    one_sentence(lambda: scenario.get(given), "is not a scenario field")
    one_sentence(lambda: scenario.about(given), "is not a scenario field")
    assert not scenario.has(given)


@pytest.mark.parametrize("given", NO_PATH)
def test_a_folder_of_presets_must_be_a_path(given: Any):
    one_sentence(lambda: flexlab.load_preset("paper", given), "own = ", "is not a path")
    one_sentence(lambda: flexlab.preset_names(given), "own = ", "is not a path")


@pytest.mark.parametrize("argument", ["inputs", "outputs"])
@pytest.mark.parametrize("given", [[["pose"]], [3], 3])
def test_inputs_and_outputs_of_a_linear_model_must_be_names(argument: str, given: Any):
    one_sentence(lambda: flexlab.linearize("paper", **{argument: given}), f"{argument} = ", "a list of names")


def test_a_folder_of_presets_whose_name_is_too_long_is_refused():
    one_sentence(lambda: flexlab.preset_names("x" * 3000), "own = ", "File name too long", "name another folder")


def test_a_table_in_the_wrong_place_does_not_break_the_sentence():
    table = pd.DataFrame({"a": range(30), "b": range(30)})
    asked: list[Callable[[Any], object]] = [
        flexlab.read, flexlab.explain, flexlab.fit, flexlab.leaderboard, lambda its: flexlab.compare(its, its),
        lambda its: flexlab.simulate("paper", its), lambda its: flexlab.simulate("paper", 0.01, commands=its),
        lambda its: flexlab.simulate("paper", 0.01, law=its), lambda its: flexlab.simulate("paper", 0.01, path=its),
        lambda its: flexlab.simulate({"payload": its}, 0.01), lambda its: flexlab.simulate({"gravity": its}, 0.01),
        lambda its: flexlab.export("paper", its), lambda its: flexlab.sweep("paper", its),
    ]  # fmt: skip
    for ask in asked:
        one_sentence(lambda ask=ask: ask(table))


def test_a_folder_of_presets_may_be_a_text(tmp_path: Path):
    (tmp_path / "mine.json").write_text('{"title": "Mine"}')
    assert "mine" in flexlab.preset_names(str(tmp_path))
    assert flexlab.load_preset("mine", str(tmp_path)).title == "Mine"


@pytest.mark.parametrize("given", [0, None, slice(0, 2), ("pose",)])
def test_a_run_is_indexed_by_the_names_of_its_signals(run: flexlab.Run, given: Any):
    with pytest.raises(TypeError, match=r"names no signal: give a name, as in \['pose'\]"):
        run[given]


def test_an_option_that_would_have_no_effect_is_refused(run: flexlab.Run, tmp_path: Path):
    one_sentence(lambda: flexlab.fit(run, time="t"), "time = 't' names a column of a file")
    one_sentence(lambda: flexlab.export("paper", tmp_path / "a.urdf", part="law"), "part: an option of units")
    for name in ("a.urdf", "a.xml", "a.fmu"):
        one_sentence(
            lambda name=name: flexlab.export("paper", tmp_path / name, end=1.0), "start and end are for tables"
        )


@pytest.mark.parametrize("pose", [10**400, (0, 10**400, 0), np.array([0, 0.75, 1j]), ["0", "0.75", "0"], "a" * 5000])
def test_a_pose_must_be_three_numbers(pose: Any):
    one_sentence(lambda: flexlab.modes("paper", pose), "pose = ", "give three numbers")
    one_sentence(lambda: flexlab.linearize("paper", pose), "pose = ", "give three numbers")


@pytest.mark.parametrize("given", [-1, 1.5, "1", None, True, [1], object()])
def test_a_seed_must_be_a_whole_number(given: Any):
    for ask in (
        lambda: flexlab.tune("paper", {EI: "50:60"}, duration=0.01, candidates=8, seed=given),
        lambda: flexlab.sweep("paper", {EI: "50:60"}, 0.01, design="sobol", samples=2, seed=given),
    ):
        one_sentence(ask, "seed = ", "give a whole number of at least 0")


@pytest.mark.parametrize("given", [None, 0, -5, 2.5, "all", [1], np.zeros(2), math.nan])
def test_a_number_of_cells_must_be_a_whole_number(given: Any):
    one_sentence(lambda: flexlab.sweep("paper", {EI: [50.0]}, 0.01, most_cells=given), "most_cells = ", "at least 1")


@pytest.mark.parametrize("count", ["1000001", "99999999999", "1" * 300])
def test_a_range_with_too_many_values_is_refused(count: str):
    one_sentence(lambda: flexlab.sweep("paper", {EI: f"50:60:{count}"}), "a range has 2 to")


def test_a_cost_must_fit_in_a_float():
    one_sentence(lambda: flexlab.tune("paper", {EI: "50:60"}, cost={"rms_error.y": 10**400}), "cost: rms_error.y=1")


@pytest.mark.parametrize("height", [None, "100%", '1" onload="x', -1, 0, 2.5, math.nan, [1]])
def test_the_height_of_a_lab_must_be_a_number_of_pixels(height: Any):
    one_sentence(lambda: flexlab.Lab(height=height), "height = ", "give a whole number of at least 1")


def test_a_metric_must_have_a_unit_a_title_and_a_named_function():
    def work(samples: flexlab.Samples) -> float:
        return 1.0

    bare: Any = flexlab.metric
    one_sentence(lambda: bare(work), "unit = <function", '@flexlab.metric("J")')
    for unit in (None, 5, "", b"J", ["J"]):
        one_sentence(lambda unit=unit: bare(unit), "unit = ", "is not a unit")
    for title in (None, 5, b"x", np.zeros(2)):
        one_sentence(lambda title=title: bare("J", title), "title = ", "give a text")
    for of in (None, 5, np.zeros(2), ["run"]):
        one_sentence(lambda of=of: bare("J", of=of), "of = ", "is not usable")
    for function in (None, 5, "work", lambda samples: 1.0, np.zeros(2)):
        one_sentence(lambda function=function: flexlab.metric("J")(function), "makes no metric")
    for name in (
        "key",
        "rows",
        "note",
    ):  # A sweep failed with "Multiple matches for FieldRef", `run.metrics.rows` was another.
        work.__name__ = name
        one_sentence(lambda: flexlab.metric("J")(work), f"The name {name} is taken")


@pytest.mark.parametrize("gives", [1j, np.array([1 + 2j]), "3.0", None, np.array("3"), {"J": 1.0}])
def test_a_metric_must_return_real_numbers(run: flexlab.Run, gives: Any):
    from flexlab.analysis.metrics.metric import forget

    @flexlab.metric("J")
    def odd_work(samples: flexlab.Samples) -> Any:
        return gives

    try:
        one_sentence(lambda: flexlab.simulate("paper", 0.01).metrics, "The metric odd_work gives", "real numbers")
    finally:
        forget("odd_work")


def test_a_refusal_does_not_repeat_a_very_long_name(run: flexlab.Run):
    long = "a" * 5000
    for ask in (
        lambda: flexlab.simulate(long),
        lambda: flexlab.read(long),
        lambda: flexlab.compare(run, long),
        lambda: flexlab.simulate_many(["paper"], 0.01, workers=long),  # type: ignore[arg-type]
        lambda: flexlab.linearize("paper", inputs=long),
        lambda: flexlab.linearize("paper", outputs=long),
    ):
        with pytest.raises(FlexlabError) as caught:
            ask()
        assert len(str(caught.value)) < 1500


def simulate_in_this_process(changes: dict[str, Any]) -> str:
    return flexlab.simulate(flexlab.load_preset("paper").replace(changes), 0.01).result_hash


def test_a_refusal_of_another_process_arrives_whole():
    """An error that cannot be unpickled ends the pool: "A process in the process pool was terminated abruptly"."""
    with ProcessPoolExecutor(1, get_context("spawn")) as other:
        with pytest.raises(ScenarioError, match=f"^{re.escape(EI)} = -5 N·m² is outside") as caught:
            other.submit(simulate_in_this_process, {EI: -5.0}).result()
        assert [path for path, _ in caught.value.problems] == [EI]
        assert other.submit(simulate_in_this_process, {}).result() == simulate_in_this_process({})


def test_one_number_is_no_list_of_scenarios():
    with pytest.raises(StudyError, match="is not a list"):
        flexlab.simulate_many(np.array(1.0))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "given", [None, 5, "ab", (), (1,), (0, 0, 0), {0, 1}, {}, np.array(1.0), np.zeros(3), object()]
)
def test_the_point_of_a_pull_or_tap_must_be_two_numbers(given: Any):
    for name, command in {"pull target": Pull(0.1, given, 1.0), "tap": Tap(0.1, given)}.items():
        one_sentence(
            lambda command=command: flexlab.simulate("paper", 0.01, commands=[(0.0, command)]), f"{name} = ", "(x, y)"
        )


def test_a_pull_or_tap_may_have_numbers_of_numpy(tmp_path: Path):
    point, half = np.array([0.0, 0.5]), np.float32(0.5)
    commands = [
        (0.002, Tap(np.float32(0.125), point)),
        (0.004, Pull(half, point, np.int64(50), (np.int64(1), np.int64(2)))),
    ]
    plain = [(0.002, Tap(0.125, (0.0, 0.5))), (0.004, Pull(0.5, (0.0, 0.5), 50, (1, 2)))]
    run = flexlab.simulate("paper", 0.01, commands=commands)  # type: ignore[arg-type]
    assert run.result_hash == flexlab.simulate("paper", 0.01, commands=plain).result_hash
    assert flexlab.replay(run.save(tmp_path)).agrees


@pytest.mark.parametrize(
    "link", [np.zeros(2), np.array(1.0), (1.0, 2.0), (True, True), "11", 5, (1, 1, 1), (np.zeros(2), 1)]
)
def test_a_pulled_link_must_be_two_whole_numbers(link: Any):
    one_sentence(
        lambda: flexlab.simulate("paper", 0.01, commands=[(0.0, Pull(0.1, (0, 0), 1.0, link))]), "pulled link = "
    )


@pytest.mark.parametrize("given", [10**400, "a" * 5000])
def test_the_numbers_of_a_pull_or_tap_must_fit_in_a_float(given: Any):
    for command in (
        Pull(given, (0, 0), 1.0),
        Pull(0.1, (given, 0), 1.0),
        Pull(0.1, (0, 0), given),
        Tap(0.1, (given, 0)),
    ):
        one_sentence(lambda command=command: flexlab.simulate("paper", 0.01, commands=[(0.0, command)]), " = ")


def test_a_unit_replaces_no_file_of_another_kind(run: flexlab.Run, tmp_path: Path):
    """It was written in the place of a recording."""
    file = run.save(tmp_path / "mine.rrd")
    before = file.read_bytes()
    one_sentence(lambda: flexlab.export_fmu("paper", file), "mine.rrd cannot be written: let its name end in .fmu.")
    assert file.read_bytes() == before


@pytest.mark.parametrize("given", [[], {}, np.zeros(0), None, object()])
def test_a_unit_with_a_wrong_part_version_or_period_is_refused(given: Any, tmp_path: Path):
    file = tmp_path / "a.fmu"
    one_sentence(lambda: flexlab.export_fmu("paper", file, part=given), "part = ", "is not a part")
    one_sentence(lambda: flexlab.export_fmu("paper", file, version=given), "fmi = ", "choose 2 or 3")
    one_sentence(lambda: flexlab.export_fmu("paper", file, sample_period=given), "sample_period = ", "is not usable")
    assert not file.exists()


@pytest.mark.parametrize("given", [5, math.nan, "leaderbord", object(), [], b"rms_error.y", np.zeros(3)])
def test_a_metric_must_be_a_known_name(run: flexlab.Run, given: Any, tmp_path: Path):
    one_sentence(lambda: run.metrics[given], " is not a metric: choose one of ")
    swept = flexlab.sweep("paper", {EI: [50.0]}, 0.01, folder=tmp_path, progress=False)
    tuned = flexlab.tune("paper", {EI: "50:60"}, duration=0.01, candidates=8, progress=False)
    for ask in (swept.plot, tuned.plot, swept.column, swept.texts, flexlab.compare(run, run).plot):
        one_sentence(lambda ask=ask: ask(given), " is not a ")


@pytest.mark.parametrize("file", ["a.csv", "a.npz", "a.html", "a.zip", "a.urdf", "a.fmu"])
def test_an_unknown_option_of_export_is_refused(run: flexlab.Run, file: str, tmp_path: Path):
    """For a unit it was a TypeError about another function, and for a table it was called an option of units."""
    one_sentence(
        lambda: flexlab.export(run, tmp_path / file, nope=1), "nope: export has no such option: there are start"
    )
    one_sentence(
        lambda: flexlab.export("paper", tmp_path / file, nope=1, part="law"), "nope: export has no such option"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("given", ["", "pd", 5, -1, math.nan, True, object(), {"pd": 1}, {"pd"}])
def test_laws_and_cases_must_be_lists(given: Any):
    for name in ("laws", "more_laws", "cases"):
        asked: dict[str, Any] = {"laws": ["pd"], "cases": ["B1"], name: given}
        one_sentence(lambda asked=asked: flexlab.leaderboard(**asked), f"{name} = ", "is not a list")


def test_a_leaderboard_without_laws_or_cases_is_refused():
    one_sentence(lambda: flexlab.leaderboard([], ["B1"]), "laws is empty: name one law or more")
    one_sentence(lambda: flexlab.leaderboard(["pd"], []), "cases is empty: name one case or more")


@pytest.mark.parametrize("given", [np.zeros(3), 5, True, "x", object(), [5]])
def test_changes_and_robust_scenarios_must_be_a_dictionary_or_a_list(given: Any):
    one_sentence(
        lambda: flexlab.tune("paper", {EI: "50:60"}, robust=given, duration=0.01, candidates=8),
        "robust = ",
        "is not usable",
    )
    one_sentence(lambda: flexlab.tune("paper", given, duration=0.01, candidates=8), "change = ", "is not usable")


@pytest.mark.parametrize("given", NO_TEXT)
def test_a_cluster_must_be_an_address(given: Any):
    one_sentence(lambda: flexlab.simulate_many(["paper"], 0.01, cluster=given), "cluster = ", "as in 'tcp://HOST:8786'")


@pytest.mark.parametrize(
    ("given", "nested"),
    [
        ({"payload.length": 0.4}, '{"payload": {"length": …}}'),
        ({"payload": {"damping.coefficient": 1}}, '{"damping": {"coefficient": …}}'),
    ],
)
def test_a_dotted_path_as_a_key_is_answered_with_the_nested_form(given: Any, nested: str):
    """The answer was: 'payload.length' is not a scenario field: did you mean payload.length?"""
    one_sentence(lambda: flexlab.simulate(given, 0.01), "names a field by its path", nested)


def test_help_shows_nothing_private():
    shown = pydoc.render_doc(flexlab.Run, renderer=pydoc.plaintext)
    assert "name: str = 'run'" in shown
    # The last two are Python 3.13's own.
    shown = re.sub(r"_repr_html_|pathlib\._local|__replace__ = _replace\(", "", shown)
    assert re.findall(r"(?<!\w)_[a-z]\w+", shown) == []
