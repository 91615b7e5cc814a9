"""Studies on a real server, without a browser: what may be varied, progress, results, and where a cell leads."""

import base64
import json
import math
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from http_client import PATIENCE, ask, over, post, wait_until
from person import open_server

import flexlab
from flexlab.analysis.metrics.metric import number_names
from flexlab.analysis.sweep.axes import parse_axes, varied_fields
from flexlab.analysis.sweep.plan import make_plan, run_part
from flexlab.analysis.sweep.result import Sweep, join_parts, save_part
from flexlab.control.paths.table import MOST_ROWS
from flexlab.errors import FlexlabError, StudyError
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.server.front_server import FrontServer
from flexlab.server.limits import THE_SERVER
from flexlab.server.scenario_links import LONGEST_LINK, decode_scenario, encode_scenario
from flexlab.server.studies import MOST_AT_ONCE, MOST_VALUES, number_of, read_study
from flexlab.server.studies.sweep import SweepStudy, page_data
from flexlab.server.task_book import Task
from flexlab.text import number_text

EI, K, LENGTH = "payload.bending_stiffness", "controller.feedback_gain", "payload.length"
STUDY_PATIENCE = 4 * PATIENCE
"""Time that a study may take, s: its process has a low priority."""
SWEEP = {
    "scenario": encode_scenario(load_preset("paper")), "name": "paper", "kind": "sweep", "duration": "0.05",
    "field1": LENGTH, "low1": "0.5", "high1": "9.5", "count1": "2",
    "field2": EI, "low2": "50", "high2": "200", "count2": "3", "log2": "yes",
}  # fmt: skip
TUNING = SWEEP | {
    "kind": "tuning", "field1": K, "low1": "50", "high1": "500", "field2": "", "cost": "rms-y", "candidates": "16",
    "limited": "torque", "limit": "1e6",
}  # fmt: skip


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FrontServer]:
    """One server for all studies of this file."""
    with open_server(tmp_path_factory.mktemp("logs"), "soft-beam") as opened:
        yield opened


def finished(server: FrontServer, form: dict[str, str]) -> str:
    """Start a study, wait until it has ended, and return its address."""
    address = post(server.url, "/studies", form).headers["Location"]
    over(server.url, f"{address}/state", STUDY_PATIENCE)
    return address


@pytest.fixture(scope="module")
def swept(server: FrontServer) -> str:
    """The address of a sweep of six cells; in three of them the arms cannot reach the beam."""
    return finished(server, SWEEP)


def test_every_field_that_may_be_varied_is_one_number_with_its_range():
    fields = {item.path: item for item in varied_fields(load_preset("paper"))}
    assert {EI, K, "gravity", "payload.damping.coefficient"} <= set(fields)
    assert not [path for path in fields if "simulation" in path or path.endswith((".elbow", ".seed", ".kind"))]
    assert fields[EI].words == "Bending stiffness EI (N·m²)"
    for item in fields.values():
        assert item.about.low <= item.range[0] < item.range[1] <= item.about.high, item.path


def test_a_field_is_offered_without_the_word_that_only_files_know():
    words = {item.path: item.words for item in varied_fields(load_preset("composite"))}
    assert words["controller.control_period"] == "Control period T_c (s)", (
        "it was Control period (null: continuous) T_c (s)"
    )


def test_the_page_offers_the_lab_and_all_presets(server: FrontServer):
    page = ask(server.url, "/studies").text
    assert '<option value="lab" selected>the lab as it is now: A soft beam' in page
    assert '<option value="vibration-damping">' in page
    assert f'<option value="{EI}" data-low="1" data-high="1000" data-log="yes"' in page
    assert "1/(kg·s)" in ask(server.url, "/studies?from=vibration-damping").text, "fields are those of the scenario"
    assert ask(server.url, "/studies?from=nothing").status == 404


def test_the_page_does_without_a_lab_whose_law_only_its_own_process_knows(open_another: Callable[..., FrontServer]):
    """A private lab takes up a law that was saved after the server had started."""
    opened = open_another()
    [lab] = opened.places.running()
    unknown = {"controller": {"kind": "own-of-another-process"}}
    word = base64.urlsafe_b64encode(zlib.compress(json.dumps(unknown).encode())).decode().rstrip("=")
    assert "the lab as it is now" in ask(opened.url, "/studies").text
    lab._shown = lab._shown[0], word  # type: ignore[attr-defined]
    page = ask(opened.url, "/studies")
    assert (page.status, "the lab as it is now" in page.text) == (200, False)
    assert '<option value="paper" selected>' in page.text


def test_a_sweep_has_the_numbers_of_the_command_line_and_says_what_failed(server: FrontServer, swept: str, tmp_path):
    found = json.loads(ask(server.url, f"{swept}/data").text)
    own = flexlab.sweep(
        "paper", [f"{LENGTH}=0.5:9.5:2", f"{EI}=50:200:log:3"], 0.05, folder=tmp_path / "own", progress=False
    )
    assert found["status"] == own.table.column("status").to_pylist()
    assert found["status"][:3] == ["finished"] * 3
    assert "reach" in found["sentence"][3]
    metric = next(item for item in found["metrics"] if item["field"] == "rms-y")
    assert metric["values"][:3] == own.column("RMS error y [mm]")[:3].tolist()
    assert metric["values"][3:] == [None] * 3
    assert [axis["unit"] for axis in found["axes"]] == ["m", "N·m²"]
    assert ask(server.url, f"{swept}/cells.parquet").body == (own.folder / "cells.parquet").read_bytes()
    assert f'href="{swept}"' in ask(server.url, "/studies").text


def test_a_map_shows_the_first_cells_while_the_others_are_computed(tmp_path: Path):
    plan = make_plan(
        load_preset("paper"), parse_axes([f"{EI}=50:200:8", f"{K}=100:300:16"], load_preset("paper")), 0.01, 1e-3
    )
    folder = tmp_path / "sweep"
    (folder / "parts").mkdir(parents=True)
    study, task = SweepStudy(plan.scenario, plan.axes, plan), Task("", THE_SERVER, folder)

    def drawn() -> dict[str, Any]:
        return study.drawing(task) or {}

    assert drawn()["status"] == [None] * 128
    parts = list(plan.parts())
    for cells in (parts[40], parts[3]):
        save_part(folder, plan, run_part(plan, cells))
    half = drawn()
    there = [*parts[3], *parts[40]]
    assert [cell for cell, status in enumerate(half["status"]) if status == "finished"] == there
    for cells in parts:
        if set(cells).isdisjoint(there):
            save_part(folder, plan, run_part(plan, cells))
    assert drawn()["status"] == ["finished"] * 128
    join_parts(folder, plan)
    whole = page_data(plan, [Sweep(plan, folder).columns()])
    assert drawn() == whole, "the parts are gone, and the page has what it had read"
    metric = next(k for k, item in enumerate(whole["metrics"]) if item["field"] == "rms-y")
    assert [half["metrics"][metric]["values"][cell] for cell in there] == [
        whole["metrics"][metric]["values"][cell] for cell in there
    ]


def test_a_sweep_has_data_while_it_is_computed(server: FrontServer):
    address = post(server.url, "/studies", SWEEP | {"count1": "30", "count2": "30", "high1": "0.55", "duration": "6"})
    study = address.headers["Location"]
    found = json.loads(ask(server.url, f"{study}/data").text)
    assert len(found["status"]) == 900
    assert None in found["status"]
    assert 'id="chart"' in ask(server.url, study).text
    assert "cells.parquet" not in ask(server.url, study).text
    post(server.url, f"{study}/cancel", {})


def test_control_laws_are_swept_on_the_page(server: FrontServer):
    page = ask(server.url, "/studies").text
    assert (
        '<option value="controller.kind" data-choice="yes" data-now="adaptive-sliding-mode">Control law</option>'
        in page
    )
    assert 'name="words1" value="controller.kind=computed-torque" checked> computed-torque' in page
    assert "controller.kind=lqr" not in page, "not with continuous control"
    form = [(name, value) for name, value in SWEEP.items() if name not in ("field1", "low1", "high1", "count1")]
    laws = [("field1", "controller.kind"), ("words1", "payload.boundary=pinned-pinned")]
    laws += [("words1", f"controller.kind={law}") for law in ("pd", "computed-torque")]
    answer = post(server.url, "/studies", form + laws)
    address = answer.headers["Location"]
    assert "Control law: pd, computed-torque" in ask(server.url, address).text
    over(server.url, f"{address}/state", STUDY_PATIENCE)
    found = json.loads(ask(server.url, f"{address}/data").text)
    assert [(axis["title"], axis["numeric"], len(axis["values"])) for axis in found["axes"]] == [
        ("Control law", False, 2), ("Bending stiffness", True, 3),
    ]  # fmt: skip
    assert found["status"] == ["finished"] * 6
    ask(server.url, f"{address}/cells/5")
    wait_until(lambda: of_lab(server).controller.kind == "computed-torque", "the cell leads to the lab")


def of_lab(server: FrontServer) -> Scenario:
    """The present scenario of the server's lab."""
    [lab] = server.places.running()
    return decode_scenario(lab.status().link)


def test_a_cell_leads_to_its_scenario_in_the_lab(server: FrontServer, swept: str):
    answer = ask(server.url, f"{swept}/cells/2")
    assert (answer.status, answer.headers["Location"]) == (303, "/lab/")
    stiffness = json.loads(ask(server.url, f"{swept}/data").text)["axes"][1]["values"][2]
    scenario = load_preset("paper").replace({EI: stiffness})
    assert stiffness == pytest.approx(200.0)
    wait_until(lambda: of_lab(server) == scenario, "the lab shows the cell")
    assert "cells 0 to 5" in ask(server.url, f"{swept}/cells/6").text
    assert ask(server.url, f"{swept}/cells/-1").status == 404
    assert ask(server.url, f"{swept}/cells/2", Sec_Fetch_Dest="image").status == 403


def test_a_scenario_that_is_too_long_for_a_link_is_studied_and_opened(server: FrontServer):
    rows = [(k / 30, 0.05 * math.sin(k / 30) ** 2, 0.0, 0.0) for k in range(MOST_ROWS)]  # Measured, with every digit.
    scenario = Scenario().replace({"trajectory": {"kind": "table", "rows": rows}})
    assert len(encode_scenario(scenario)) > LONGEST_LINK
    form = SWEEP | {"scenario": encode_scenario(scenario), "field1": "", "count2": "2"}
    address = finished(server, form)
    assert "Open the scenario in the lab" not in ask(server.url, address).text
    assert ask(server.url, f"{address}/cells/1").status == 303
    wait_until(lambda: of_lab(server).trajectory == scenario.trajectory, "the lab shows the cell")
    assert "the lab as it is now" in ask(server.url, "/studies").text
    assert json.loads(ask(server.url, "/state/lab").text)["link"] == ""


def test_a_tuning_shows_before_and_after_and_leads_to_the_lab(server: FrontServer):
    address = finished(server, TUNING)
    page = ask(server.url, address).text
    assert "Open the result in the lab" in page
    assert "Peak joint torque" in page
    assert ">Feedback gain K (N·s/m, N·m·s/rad)<" in page, "with its symbol, as everywhere"
    found = json.loads(ask(server.url, f"{address}/data").text)
    assert len(found["points"]) >= 16
    assert found["after"][0] < found["before"][0]
    assert found["titles"] == ["RMS error y (mm)", "Peak joint torque (N·m)"]
    before, after = (f">{number_text(found[when][0])}<" for when in ("before", "after"))
    assert 0 < page.find(before) < page.find(after)


def test_a_tuning_gives_no_settling_time_of_a_run_that_has_not_settled(tmp_path: Path):
    form = TUNING | {"cost": "settled", "limited": "", "field1": K}
    study = read_study(form, load_preset("paper"))
    found = study.job()(lambda share: None).result
    task = Task("settled", THE_SERVER, tmp_path, working=False, result=found)
    assert study.found(task).lines[-1] == ("Vibration below 1 % after (s)", "not settled", "not settled")
    drawn = study.drawing(task)
    assert drawn is not None
    assert drawn["points"] == []
    assert found.before.cost == pytest.approx(0.5), "the search takes it to be ten times the run's length"


def test_too_many_studies_are_refused_and_cancelled_ones_end(server: FrontServer):
    long = SWEEP | {"count1": "30", "count2": "30", "high1": "0.55", "duration": "6"}
    most = sum(MOST_AT_ONCE[2:])
    begun = [post(server.url, "/studies", long).headers["Location"] for _ in range(most)]
    refused = post(server.url, "/studies", long)
    assert (refused.status, f"This server has {most} studies already" in refused.text) == (503, True)
    for address in begun:
        assert post(server.url, f"{address}/cancel", {}).headers["Location"] == address
        assert json.loads(ask(server.url, f"{address}/state").text)["sentence"] == "Cancelled."
        assert ask(server.url, f"{address}/data").status == 404


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (
            {"count1": "50", "count2": "50"},
            f"2500 cells are too many for this page: choose fewer values, {MOST_VALUES}",
        ),
        ({"count1": "1e7"}, "10⁷ values of Length L are outside 2 to 900"),
        ({"count1": "0"}, "0 values of Length L are outside 2 to 900"),
        ({"count1": "2.5"}, "is not a whole number"),
        ({"low1": "9"}, ""),
        ({"low1": "10"}, "Length L: 10 to 9.5 is empty or reversed"),
        ({"low1": "nan"}, "The lower limit of Length L 'nan' is not a number"),
        ({"low1": "x" * 5000}, "is not a number"),
        ({"high1": "1e9"}, "is outside the allowed range 0.05 to 10 m"),
        ({"low2": "-5"}, "Bending stiffness EI has equal ratios and begins at −5: begin above 0"),
        ({"field1": ""}, ""),
        ({"field1": "", "field2": ""}, "Nothing is varied"),
        ({"field2": LENGTH}, "Length L is varied twice: give"),
        ({"field1": "controller.kind"}, "Control law: nothing is ticked"),
        ({"field1": "controller.kind", "words1": "controller.kind=magic"}, "'magic' is no Control law: choose one of"),
        ({"field1": "controller.kind", "words1": "controller.kind=pd"}, ""),
        (
            {**TUNING, "field1": "controller.kind", "words1": "controller.kind=pd"},
            "Control law is a choice: a tuning searches",
        ),
        ({"field1": "payload.lenght"}, "did you mean Length L?"),
        ({"duration": "0"}, "outside 0 to 20 s"),
        ({"kind": "magic"}, "'magic' is not a study: choose one of sweep, tuning"),
        ({"duration": "20", "count1": "20", "count2": "20"}, "over the 6000 s that this page gives a study"),
        ({"kind": "tuning", "cost": "rms-y"}, "Candidates '' is not a number"),
        ({**TUNING, "candidates": "4000"}, "4000 candidates are outside 16 to 400"),
        ({**TUNING, "candidates": "1e300"}, "10³⁰⁰ candidates are outside 16 to 400"),
        ({**TUNING, "candidates": "-1" + "0" * 300}, "−10³⁰⁰ candidates are outside 16 to 400"),
        ({"count1": "1e300"}, "10³⁰⁰ values of Length L are outside 2 to 900"),
        ({"count1": "-1e300"}, "−10³⁰⁰ values of Length L are outside 2 to 900"),
        ({"low1": "1e300", "high1": "1e301"}, "is outside the allowed range"),
        ({"field1": "payload." + "x" * 5000}, "field"),
        ({**TUNING, "cost": "beauty"}, "is not a metric"),
        ({**TUNING, "limit": "0"}, "give a number above 0"),
    ],
)
def test_an_invalid_study_is_refused_in_a_sentence(changes: dict[str, str], says: str):
    form, paper = SWEEP | changes, load_preset("paper")
    if not says:
        assert read_study(form, paper).axes
        return
    with pytest.raises(FlexlabError) as caught:
        read_study(form, paper)
    assert says in str(caught.value)
    assert len(str(caught.value).replace(", ".join(number_names()), "")) < 300, (
        "besides the metrics, of which there may be more"
    )


@pytest.mark.parametrize(
    ("typed", "meant"), [("0,5", 0.5), ("−0.5", -0.5), ("-1,25e3", -1250.0), (",125", 0.125), ("0,125", 0.125)]
)
def test_a_number_may_have_a_decimal_comma_or_the_page_s_own_minus_sign(typed: str, meant: float):
    assert number_of({"low1": typed}, "low1", "It") == meant


@pytest.mark.parametrize("typed", ["1,000", "-12,500", "1,000.5", "1,2,3", ",", "1.5,2"])
def test_a_comma_that_may_separate_thousands_is_refused(typed: str):
    with pytest.raises(StudyError, match=r"is not a number: write one such as 0\.5"):
        number_of({"low1": typed}, "low1", "It")


def test_a_study_keeps_every_digit_of_a_range_and_names_its_spacing():
    study = read_study(SWEEP | {"low1": "0.123456789"}, load_preset("paper"))
    assert study.axes[0].low == 0.123456789
    assert [study.axis_text(axis) for axis in study.axes] == [
        "Length L: 0.1235 to 9.5 m, 2 values", "Bending stiffness EI: 50 to 200 N·m², equal ratios, 3 values",
    ]  # fmt: skip


def test_hostile_forms_and_unknown_studies_are_answered_without_a_traceback(server: FrontServer):
    for form, status in (({}, 422), ({"scenario": "zz"}, 422), (SWEEP | {"count1": "99", "count2": "99"}, 422)):
        answer = post(server.url, "/studies", form)
        assert (answer.status, "Traceback" in answer.text) == (status, False)
    for path in ("/studies/none", "/studies/none/state", "/studies/none/data", "/studies/none/cells.parquet"):
        assert ask(server.url, path).status == 404
    assert post(server.url, "/studies/none/cancel", {}).status == 404
    foreign = post(server.url, "/studies", SWEEP, Origin="http://elsewhere.example")
    assert foreign.status == 403
