"""The leaderboard: each row is the run that it names, computed once and verifiable, and a law that fails says why."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import flexlab
from flexlab.analysis.figures import svg_text
from flexlab.analysis.leaderboard.board import Leaderboard, make_tasks, run_board, verify
from flexlab.analysis.leaderboard.case import Case, Variant, cases, chosen_cases, peak_error, settled
from flexlab.analysis.leaderboard.entry import Row, chosen_entrants, entrants
from flexlab.analysis.leaderboard.figures import draw_case
from flexlab.analysis.leaderboard.report import OF_THE_BEST as BEST
from flexlab.analysis.leaderboard.report import Cell, overview, ratios, sections, settings, write_report
from flexlab.analysis.leaderboard.store import RowStore, engine, law_source
from flexlab.analysis.result import scenario_hash
from flexlab.analysis.workers import chosen_workers
from flexlab.cli import leaderboard_command
from flexlab.errors import StudyError
from flexlab.presets import load_preset
from flexlab.sim.commands import Tap

TAP = (0.004, Tap(0.0, (0.0, 0.1)))
QUICK = Case(
    "Q",
    "Quick",
    "Twelve milliseconds with a tap.",
    0.012,
    (peak_error(), settled()),
    variants=(Variant("stiff"), Variant("soft", {"payload.bending_stiffness": 10.0})),
    commands=(TAP, (5.0, TAP[1])),  # The second one comes after the end.
)
LAWS = ("adaptive-sliding-mode", "pd", "lqr")
OWN = '''from flexlab import OwnLaw


class Push(OwnLaw):
    """Pushes."""

    def act(self, at):
        return at.weights + at.shared([PUSH, 0.0, 0.0])
'''


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("leaderboard")


@pytest.fixture(scope="module")
def board(folder: Path) -> Leaderboard:
    return flexlab.leaderboard(LAWS, [QUICK], folder=folder, progress=False)


def verified(rows: tuple[Row, ...]) -> list[tuple[Row, str]]:
    return list(verify(rows, make_tasks([QUICK], chosen_entrants(LAWS))))


def test_a_row_is_the_run_that_simulate_gives(board: Leaderboard):
    soft = load_preset("paper").replace({"payload.bending_stiffness": 10.0, "controller.kind": "pd"})
    run = flexlab.simulate(soft, QUICK.duration, commands=[TAP])
    row = board.row(QUICK, QUICK.variants[1], "pd")
    assert row is not None
    assert (row.status, row.sentence, row.seed) == ("finished", "", 0)
    assert row.result_hash == run.result_hash
    assert row.scores["peak"] == pytest.approx(abs(run.tracking_error[:, 0] + 1j * run.tracking_error[:, 1]).max())
    assert row.scores["settled"] is None, "it still rings"
    (line,) = (line for line in board.table.to_pylist() if line["key"] == row.key and line["score"] == "peak")
    assert line["scenario"] == scenario_hash(run.scenario)


def test_rows_that_are_known_are_not_computed_again(board: Leaderboard, folder: Path):
    assert board.computed == len(board.rows) == 6
    again = flexlab.leaderboard(LAWS, [QUICK], folder=folder, progress=False)
    assert (again.computed, again.rows) == (0, board.rows)
    assert RowStore(folder).last() == board.rows


def test_only_the_rows_of_what_changed_are_computed(board: Leaderboard, tmp_path: Path, folder: Path):
    file = tmp_path / "push.py"
    computed = []
    for push in (1.0, 2.0, 2.0):
        file.write_text(OWN.replace("PUSH", str(push)))
        found = flexlab.leaderboard(LAWS, [QUICK], more_laws=[file], folder=folder, progress=False)
        computed.append(found.computed)
    assert computed == [2, 2, 0]
    assert found.laws[-1] == "push"
    assert flexlab.leaderboard(LAWS, [QUICK], seed=np.int64(0), folder=folder, progress=False).computed == 0
    noisy = make_tasks([QUICK], chosen_entrants(LAWS), seed=1)
    assert not {task.row.key for task in noisy} & {row.key for row in board.rows}
    longer = make_tasks([replace(QUICK, duration=0.013)], chosen_entrants(LAWS))
    assert not {task.row.key for task in longer} & {row.key for row in board.rows}
    untouched = make_tasks([replace(QUICK, commands=())], chosen_entrants(LAWS))
    assert not {task.row.key for task in untouched} & {row.key for row in board.rows}


def test_a_laws_key_depends_on_its_own_file_and_on_the_laws_it_uses():
    paper = load_preset("paper")
    kinds = {kind: paper.replace({"controller.kind": kind}) for kind in ("pd", "computed-torque", "composite")}
    assert len({law_source(scenario) for scenario in kinds.values()}) == 3
    other = kinds["composite"].replace({"controller.slow.kind": "pd"})
    assert law_source(other) != law_source(kinds["composite"])


@pytest.mark.parametrize(
    ("file", "counts"),
    [
        ("numerics/elementary.py", True),
        ("physics/beam.py", True),
        ("sim/world.py", True),
        ("own/law.py", True),
        ("scenario/payload.py", True),
        ("analysis/metrics/magnitudes.py", True),
        ("compiled.py", True),
        ("control/laws/lqr.py", False),
    ],
)
def test_the_engine_is_another_if_any_file_that_computes_rows_changes(
    file: str, counts: bool, monkeypatch: pytest.MonkeyPatch
):
    """A change of the elementary functions once left it the same, so that old rows passed for new ones."""
    present, read = engine(), Path.read_bytes
    changed = Path(flexlab.__file__).parent / file
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + b" " * (path == changed))
    assert (engine.__wrapped__() != present) == counts


def test_verification_reproduces_every_row(board: Leaderboard):
    found = verified(board.rows)
    assert len(found) == 6
    assert not any(difference for _, difference in found)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("scores", {"peak": 1e-3, "settled": None}, "the score peak is 0.001, and "),
        ("result_hash", "0" * 16, "result hash is 0000000000000000, and "),
        ("status", "diverged", "status is diverged, and finished here"),
    ],
)
def test_verification_names_what_was_changed(board: Leaderboard, name: str, value: object, says: str):
    kept = board.rows[1]
    difference = next(said for row, said in verified((replace(kept, **{name: value}),)) if row.law == kept.law)
    assert says in difference
    assert "the table was changed" in difference
    older = replace(kept, **{name: value}, engine="another")
    assert "with other sources, another" in verified((older,))[0][1]


def test_a_row_whose_file_was_damaged_is_computed_again(tmp_path: Path):
    tasks = make_tasks([replace(QUICK, variants=QUICK.variants[:1])], chosen_entrants(["pd"]))
    store = RowStore(tmp_path)
    first = run_board(tasks, store)
    file = next((tmp_path / "rows").iterdir())
    for text in ("", "[1]", json.dumps({**first.rows[0].as_data(), "seed": "x"})):
        file.write_text(text)
        assert store.get(tasks[0].row.key) is None
    assert run_board(tasks, store) == first
    for key, name in (("another", "rows/other"), ("../outside", "outside")):
        (tmp_path / f"{name}.json").write_text(json.dumps(first.rows[0].as_data() | {"key": key}))
    (tmp_path / "last.json").write_text(json.dumps(["other", "../outside", first.rows[0].key]))
    assert store.last() == first.rows, "none under another key, or from another folder"


def test_a_law_that_fails_is_listed_with_the_reason(tmp_path: Path):
    file = tmp_path / "broken.py"
    file.write_text(OWN.replace("PUSH", "1 / 0").replace("Push", "Broken"))
    far = replace(QUICK, variants=(Variant("near"), Variant("far", {"trajectory.center": (0.0, 1.6, 0.0)})))
    found = flexlab.leaderboard(["pd", file], [far], folder=tmp_path / "rows", progress=False)
    (section,) = sections(found)
    assert [cell.text for cell in dict(section.main.lines)["pd"]][1] == "fails"
    assert [cell.text for cell in dict(section.main.lines)["broken"]] == ["fails", "fails"]
    assert any(text.startswith("broken (near): ") and "broken.py, line 8" in text for text in section.failures)
    assert any(text.startswith("pd (far): ") and "reach" in text for text in section.failures)
    assert dict(overview(found).lines)["pd"][0].text == "fails 1 of 2"


def test_the_overview_has_geometric_means_over_the_best_laws_and_shades_by_factors_of_two():
    peaks = {"a": (1e-3, 3e-3), "b": (2e-3, 1e-3), "c": (1e-3, None), "d": (1e-3, 1e-12)}
    rows = [
        Row(
            law,
            "Q",
            variant.name,
            "finished" if peak else "diverged",
            "",
            "",
            {"peak": peak} if peak else {},
            0,
            *"hkevm",
        )
        for law, both in peaks.items()
        for variant, peak in zip(QUICK.variants, both, strict=True)
    ]
    found = Leaderboard((QUICK,), tuple(rows[:6]))
    assert [cells[0] for _, cells in overview(found).lines][:2] == [Cell("1.22", 1, BEST), Cell("1.00", 0, BEST)]
    (section,) = sections(found)
    assert [[(cell.text, cell.level) for cell in cells] for _, cells in section.main.lines] == [
        [("1.000", 0), ("3.000", 2)], [("2.000", 1), ("1.000", 0)], [("1.000", 0), ("fails", None)]
    ]  # fmt: skip
    best = Leaderboard((QUICK,), tuple(rows))
    assert ratios(best, QUICK, QUICK.variants[1], QUICK.main) == {"a": 3e6, "b": 1e6, "d": 1.0}, "a nanometre is exact"
    assert found.plot().axes[0].lines[1].get_xdata() == pytest.approx([3, 1, np.nan], nan_ok=True)


def test_the_settings_say_which_laws_were_sampled_unlike_the_case(
    board: Leaderboard, capsys: pytest.CaptureFixture[str]
):
    assert settings(board) == {"lqr": ["sampled, Control period T_c (s) = 0.001"]}
    leaderboard_command._print(board)
    assert "own: lqr: sampled, Control period T_c (s) = 0.001.\n" in capsys.readouterr().out


def test_every_law_enters_and_only_laws_with_leakage_get_the_leaky_variant():
    tasks = make_tasks(chosen_cases(["B5", "B7"], long=True), tuple(entrants().values()))
    assert not [task.row.sentence for task in tasks if task.row.sentence]
    entered = {
        one.row.variant: {task.row.law for task in tasks if task.row.variant == one.row.variant} for one in tasks
    }
    leaking = {"adaptive-sliding-mode", "vibration-damping", "composite", "composite-kalman", "composite-soft"}
    assert entered == {
        "2 elements": entrants().keys(),
        "8 elements, ζ = 0.1 %": entrants().keys(),
        "σ as it is": entrants().keys(),
        "σ = 0.1 1/s": leaking,
    }
    assert {"lqr", "pd"} < entrants().keys() - {"none"} == entrants().keys()


def test_the_first_cases_are_b1_to_b8_and_the_long_one_has_to_be_asked_for():
    assert list(cases())[:8] == ["B1", "B2", "B3", "B4", "B5", "B6", "B7", "B8"]
    assert [case for case in cases().values() if case not in chosen_cases(None, long=False)] == [cases()["B7"]]
    for case in cases().values():
        assert len({score.name for score in case.scores}) == len(case.scores)
        assert all(score.formula and score.column.unit for score in case.scores)


def test_the_files_hold_every_score_with_formula_unit_and_hashes(board: Leaderboard, tmp_path: Path):
    import pyarrow.parquet as parquet

    paths = write_report(board, tmp_path / "to")
    assert [path.name for path in paths] == ["leaderboard.html", "leaderboard.parquet", "leaderboard.csv", "Q.svg"]
    html = paths[0].read_text(encoding="utf-8")
    assert "max √(e_x² + e_y²)" in html
    assert "http://" not in html.replace("http://www.w3.org", "").replace("http://purl.org", "").replace(
        "http://creativecommons.org", ""
    )
    table = parquet.read_table(paths[1]).to_pylist()
    assert len(table) == 12
    line = next(line for line in table if (line["law"], line["variant"], line["score"]) == ("pd", "soft", "peak"))
    assert line["shown"] == 1e3 * line["value"]
    assert (line["unit"], line["formula"], line["seed"]) == ("mm", "max √(e_x² + e_y²)", 0)
    row = board.row(QUICK, QUICK.variants[1], "pd")
    assert row is not None
    assert line["key"] == row.key
    assert paths[3].read_text(encoding="utf-8").startswith("<svg")
    drawn = re.findall(r"<svg.*?</svg>", html, re.DOTALL)
    assert len(drawn) == 1
    assert "currentColor" in drawn[0]
    assert not re.search(r"<path [^>]*fill: #ffffff|stroke: #000000", drawn[0])
    again = write_report(board, tmp_path / "again")
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in paths]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({"cases": ["B9"]}, "'B9' is not a case: choose from B1, B2"),
        ({"cases": "B1"}, "cases = 'B1' is not a list"),
        ({"laws": "pd"}, "laws = 'pd' is not a list"),
        ({"laws": ["pdd"]}, "'pdd' is not a control law: choose from adaptive-sliding-mode"),
        ({"laws": ["pd"], "cases": [QUICK], "workers": 0}, "workers = 0 is not usable"),
    ],
)
def test_bad_input_is_a_sentence(tmp_path: Path, words: dict, says: str):
    with pytest.raises(StudyError, match=says):
        flexlab.leaderboard(**words, folder=tmp_path, progress=False)


def test_the_variants_of_b8_add_known_friction_compliant_grips_and_filling():
    case = cases()["B8"]
    unknown, known, compliant, filled, followed = (case.plain_scenario(variant, 0) for variant in case.variants)
    assert (unknown.controller.model.friction_factor, known.controller.model.friction_factor) == (0.0, 1.0)
    assert unknown.joints == known.joints
    assert unknown.joints.friction.active
    assert unknown.joints.motor.active
    assert unknown.joints.encoders.active
    assert compliant.joints == filled.joints == known.joints
    assert compliant.grips.active
    assert filled.payload.mass_change.active
    assert followed == filled.replace({"controller.model.mass_change_factor": 1.0})


def test_a_chart_without_any_score_has_no_numbers_on_its_axis():
    axes = draw_case(cases()["B1"], ["pd"], np.array([[np.nan]])).axes[0]
    assert [label.get_text() for label in axes.get_xticklabels()] == []
    assert [text.get_text() for text in axes.texts] == ["no score"]


def test_a_logarithmic_axis_has_plain_numbers():
    """It said 10⁻¹, 2 × 10⁻¹ and 3 × 10⁻¹ seconds."""
    figure = draw_case(cases()["B1"], ["pd", "lqr"], np.array([[0.439], [0.086]]))
    assert re.findall(r">(0\.\d+)<", svg_text(figure)) == ["0.1", "0.2", "0.3", "0.4"]


def test_a_score_too_large_for_an_axis_is_drawn_as_no_score():
    figure = draw_case(cases()["B1"], ["pd", "lqr"], np.array([[1e308], [0.1]]))
    assert len(svg_text(figure)) < 1e6
    assert [text.get_text() for text in figure.axes[0].texts] == ["no score"]


def test_numbers_in_the_table_keep_their_trailing_zeros(board: Leaderboard):
    texts = [cell.text for _, cells in overview(board).lines for cell in cells]
    assert "1.00" in texts
    assert all(len(text.replace(".", "")) == 3 for text in texts if text[0].isdecimal() and "\u202f" not in text)


def test_the_command_that_verifies_fails_if_a_row_differs(board: Leaderboard, folder: Path):
    tasks = make_tasks([QUICK], chosen_entrants(LAWS))
    altered = replace(board.rows[0], result_hash="0" * len(board.rows[0].result_hash))
    for rows, code in ((board.rows, 0), ((altered, *board.rows[1:]), 1)):
        assert leaderboard_command._verify(list(rows), tasks, RowStore(folder), chosen_workers(None)) == code
