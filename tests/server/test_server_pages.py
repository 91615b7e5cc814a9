"""The pages of a server, requested without a browser."""

import json
import os
import re
import shutil
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from aiohttp import web
from http_client import PATIENCE, ask, post, wait_until

from flexlab.presets import load_preset, preset_names
from flexlab.recording.store.notes import read_notes, write_notes
from flexlab.recording.store.run_files import is_in_use
from flexlab.server.front_server import FrontServer
from flexlab.server.labs import state_of
from flexlab.server.pages import page, runs_pages
from flexlab.server.scenario_links import encode_scenario


def test_the_start_page_names_every_preset_and_the_state_of_the_lab(front_server: FrontServer):
    page = ask(front_server.url).text
    for name in preset_names():
        assert f'href="/lab/{name}"' in page
    (lab,) = front_server.places.running()
    assert f"is {state_of(lab)} (t\xa0=\xa0" in page
    assert ask(front_server.url, "/static/style.css").headers["Content-Type"].startswith("text/css")


on_linux = pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
NAMES = [
    b"half? 50%25 #1.json",
    b"half {a}; beam&c=d+e.json",
    *(
        pytest.param(name, marks=on_linux)
        for name in (b"half a b\xfcrste.json", b"..json", b"...json", b"half\na beam.json", b"half\\a beam.json")
    ),
]


@pytest.mark.parametrize("name", NAMES)
def test_a_preset_of_any_name_opens_from_the_start_page(
    open_another: Callable[..., FrontServer], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: bytes
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "presets").mkdir()
    (tmp_path / "presets" / os.fsdecode(b"broken " + name)).write_text("{")
    (tmp_path / "presets" / os.fsdecode(name)).write_text('{"title": "Half a beam"}')
    front_server = open_another()
    card = re.search(
        r'<li class="card"><a href="([^"]*)">(?:(?!</li>).)*Half a beam', ask(front_server.url).text, re.DOTALL
    )
    assert card is not None
    assert ask(front_server.url, unescape(card[1])).status == 303
    wait_until(lambda: "Half a beam is" in ask(front_server.url).text, "the lab shows it")


def test_the_lab_s_page_is_passed_on_with_the_server_s_bar(front_server: FrontServer):
    answer = ask(front_server.url, "/lab/", Accept_Encoding="gzip")
    assert answer.status == 200
    assert b'<div id="root">' in answer.body
    assert b'src="/static/lab.js" data-state="/state/lab"' in answer.body
    again = ask(front_server.url, "/lab/", If_None_Match=answer.headers["ETag"])
    assert (again.status, again.body) == (304, b"")
    assert ask(front_server.url, "/lab?fixedDpr=0.5").headers["Location"] == "/lab/?fixedDpr=0.5"


def test_a_link_loads_its_preset_and_the_same_link_again_does_not_restart_it(open_another: Callable[..., FrontServer]):
    front_server = open_another()
    answer = ask(front_server.url, "/lab/soft-beam?fixedDpr=0.5")
    assert (answer.status, answer.headers["Location"]) == (303, "/lab/?fixedDpr=0.5")
    wait_until(lambda: '"name": "soft-beam"' in ask(front_server.url, "/state/lab").text, "the lab shows the soft beam")
    logs = front_server.settings.logs
    ask(front_server.url, "/lab/")
    ask(front_server.url, "/lab/soft-beam")
    changed = load_preset("paper").replace({"payload.bending_stiffness": 33.0, "title": "Mine"})
    ask(front_server.url, f"/lab/?scenario={encode_scenario(changed)}")
    wait_until(lambda: "Mine is paused" in ask(front_server.url).text, "the lab shows the scenario of the link")
    assert f"/lab/?scenario={encode_scenario(changed)}" in ask(front_server.url, "/state/lab").text
    # Runs are recorded in order, a little behind the lab: once the third file is there, the earlier ones are too.
    wait_until(lambda: any(logs.glob("*-shared-scenario.rrd")), "the linked run is recorded")
    assert len(list(logs.glob("*-soft-beam.rrd"))) == 1, "the same preset asked for again does not start anew"


def test_a_run_that_has_stopped_does_not_count_as_resumed(open_another: Callable[..., FrontServer]):
    front_server = open_another()
    far = load_preset("paper").replace({"trajectory.center": (0.0, 9.0, 0.0)})
    ask(front_server.url, f"/lab/?scenario={encode_scenario(far)}")
    [lab] = front_server.places.running()
    wait_until(lambda: lab.status().state == "stopped", "the arms cannot reach the payload")
    lab.visitors = 1
    told = post(front_server.url, "/teacher/resume", {}, Accept="application/json")
    assert json.loads(told.text) == {"sentence": "0 labs running again."}


@pytest.mark.parametrize(
    ("path", "status", "says"),
    [
        ("/lab/sfot-beam", 404, "did you mean soft-beam?"),
        ("/lab/?scenario=broken", 400, "copy it again"),
        ("/runs/none", 404, "There is no run none"),
        ("/runs/none.rrd", 404, "There is no run none"),
        ("/runs/delete?run=none", 404, "There is no run none"),
        ("/s/none/", 403, "You can have one of your own"),
        ("/nowhere", 404, "There is no such page"),
        ("/viewer/nothing.js", 404, "There is no such page"),
        ("/assets/", 403, "not for visitors"),
    ],
)
def test_a_wrong_address_is_answered_in_a_sentence(front_server: FrontServer, path: str, status: int, says: str):
    answer = ask(front_server.url, path)
    assert answer.status == status
    assert says in answer.text
    assert "Traceback" not in answer.text


def test_texts_of_runs_and_scenarios_are_escaped(
    open_another: Callable[..., FrontServer], recorded: Path, tmp_path: Path
):
    evil = "<script>alert(1)</script>"
    front_server = open_another()
    logs = front_server.settings.logs
    shutil.copy(recorded, logs / "2026-01-01T00-00-00-x.rrd")
    (logs / "2026-01-01T00-00-00-x.json").write_text(
        '{"preset": "%s", "note": "%s", "tags": ["%s"], "metrics": {"%s": "%s"}, "changes": ["%s"]}' % ((evil,) * 6)
    )
    scenario = load_preset("paper").replace({"title": evil, "watch": evil})
    ask(front_server.url, f"/lab/?scenario={encode_scenario(scenario)}")
    wait_until(lambda: "&lt;script&gt;" in ask(front_server.url).text, "the start page shows the scenario's title")
    for path in ("/", "/runs", "/runs/2026-01-01T00-00-00-x", "/runs/delete?run=2026-01-01T00-00-00-x"):
        page = ask(front_server.url, path).text
        assert "alert(1)" in page
        assert "<script>alert" not in page
    assert "&lt;img src=x&gt;" in ask(front_server.url, "/lab/%3Cimg%20src=x%3E").text


def test_the_library_lists_runs_serves_parts_and_saves_notes(front_server: FrontServer, logs: Path, recorded: Path):
    run = recorded.stem
    page = ask(front_server.url, "/runs").text
    assert f'href="/runs/{run}"' in page
    assert "0.5 s" in page
    assert "complete" in page
    whole = ask(front_server.url, f"/runs/{run}.rrd")
    assert whole.body == recorded.read_bytes()
    part = ask(front_server.url, f"/runs/{run}.rrd", Range="bytes=10-19")
    assert (part.status, part.body) == (206, whole.body[10:20])
    form = {"note": "Rings <nicely>", "tags": "soft, best, soft", "keep": "on"}
    saved = post(front_server.url, f"/runs/{run}/notes", form)
    assert saved.status == 303
    notes = read_notes(logs / recorded.name)
    assert (notes["note"], notes["tags"], notes["keep"]) == ("Rings <nicely>", ["soft", "best"], True)
    assert notes["preset"] == "paper"
    assert "Rings &lt;nicely&gt;" in ask(front_server.url, "/runs").text
    refused = post(front_server.url, "/runs/delete", {"run": run, "sure": "yes"})
    assert (refused.status, "marked to be kept" in refused.text) == (409, True)


def test_a_page_that_was_opened_earlier_saves_only_what_was_changed_in_it(
    open_another: Callable[..., FrontServer], recorded: Path
):
    front_server = open_another()
    run = front_server.settings.logs / recorded.name
    shutil.copy(recorded, run)
    write_notes(run, note="two\nlines", tags=["a", "b"])
    text = ask(front_server.url, f"/runs/{run.stem}").text
    shown = dict(re.findall(r'name="(shown-\w+)" value="([^"]*)"', text))
    assert shown == {"shown-note": "two\nlines", "shown-tags": "a, b", "shown-keep": ""}
    address, form = f"/runs/{run.stem}/notes", {"note": "two\r\nlines", "tags": "a, b", **shown}
    post(front_server.url, address, form | {"keep": "on"})
    post(front_server.url, address, form | {"tags": "a"})
    notes = read_notes(run)
    assert (notes["note"], notes["tags"], notes["keep"]) == ("two\nlines", ["a"], True)
    post(front_server.url, address, form | {"shown-keep": "on"})
    assert read_notes(run)["keep"] is False


def test_deleting_asks_first_and_spares_the_run_that_is_being_recorded(
    open_another: Callable[..., FrontServer], recorded: Path
):
    front_server = open_another()
    logs = front_server.settings.logs
    shutil.copy(recorded, logs / recorded.name)
    # A file appears before its recorder claims it, and is claimed before anything is in it.
    running = wait_until(
        lambda: [file for file in logs.glob("*.rrd") if is_in_use(file) and file.stat().st_size], "a recording"
    )[0]
    assert "Delete this run?" in ask(front_server.url, f"/runs/delete?run={recorded.stem}").text
    assert (logs / recorded.name).exists()
    assert post(front_server.url, "/runs/delete", {"run": recorded.stem, "sure": "yes"}).status == 303
    assert not (logs / recorded.name).exists()
    asked = ask(front_server.url, f"/runs/delete?run={running.stem}").text
    assert ("Nothing to delete" in asked, "still being recorded" in asked) == (True, True), "not asked in vain"
    refused = post(front_server.url, "/runs/delete", {"run": running.stem, "sure": "yes"})
    assert "still being recorded" in refused.text
    assert running.exists()
    assert "still being recorded" in ask(front_server.url, f"/runs/{running.stem}").text


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [("empty", b"", "is empty"), ("garbage", b"garbage" * 99, "is not a rerun recording")],
)
def test_a_file_that_is_no_run_is_listed_and_explained(open_another, name: str, content: bytes, says: str):
    front_server = open_another()
    (front_server.settings.logs / f"{name}.rrd").write_bytes(content)
    assert f'href="/runs/{name}"' in ask(front_server.url, "/runs").text
    answer = ask(front_server.url, f"/runs/{name}")
    assert (answer.status, says in answer.text) == (422, True)


def test_runs_are_measured_when_somebody_opens_the_library(open_another: Callable[..., FrontServer], recorded: Path):
    front_server = open_another()
    file = front_server.settings.logs / "2026-01-01T00-00-00-paper.rrd"
    shutil.copy(recorded, file)
    assert "1 run is being measured" in ask(front_server.url, "/runs").text
    notes = wait_until(lambda: "metrics" in read_notes(file) and read_notes(file), "the run is measured")
    value = notes["metrics"]["Peak vibration [mm]"]
    assert value > 1
    assert f"{value:.4g}</td>" in ask(front_server.url, "/runs").text
    assert "Vibration below 1\xa0% after (s)" in ask(front_server.url, f"/runs/{file.stem}").text


def test_copied_runs_are_listed_by_the_time_when_they_began(open_another: Callable[..., FrontServer], recorded: Path):
    """A copied file is newer than its run: the table used to follow the order of the copies."""
    front_server = open_another()
    logs = front_server.settings.logs
    for age, day in ((3, "02"), (1, "01"), (2, "03")):
        file = logs / f"2026-01-{day}T00-00-00-run.rrd"
        shutil.copy(recorded, file)
        os.utime(file, (1e9 - age, 1e9 - age))
    found = re.findall(r'href="/runs/(2026-01-\d\d)', ask(front_server.url, "/runs").text)
    assert list(dict.fromkeys(found)) == ["2026-01-03", "2026-01-02", "2026-01-01"]


def test_many_runs_are_listed(open_another: Callable[..., FrontServer], recorded: Path):
    front_server = open_another()
    for number in range(200):
        file = front_server.settings.logs / f"2026-01-01T00-{number // 60:02}-{number % 60:02}-run.rrd"
        shutil.copy(recorded, file)
        shutil.copy(recorded.with_suffix(".json"), file.with_suffix(".json"))
    page = ask(front_server.url, "/runs").text
    assert len(re.findall(r'href="/runs/2026-01-01T', page)) >= 200


def test_a_long_list_of_runs_delays_nobody_else(front_server: FrontServer, monkeypatch: pytest.MonkeyPatch):
    """With 10,000 runs, every page and every lab's connection stood still for five seconds."""
    begun, served = threading.Event(), threading.Event()

    def long_page(*words: str, **values: Any) -> web.Response:
        begun.set()
        assert served.wait(PATIENCE)
        return page(*words, **values)

    monkeypatch.setattr(runs_pages, "page", long_page)
    with ThreadPoolExecutor(1) as thread:
        library = thread.submit(ask, front_server.url, "/runs")
        assert begun.wait(PATIENCE)
        assert ask(front_server.url, "/static/style.css").status == 200
        served.set()
        assert library.result().status == 200


def test_the_viewer_is_served_with_a_policy_that_names_this_address_only(front_server: FrontServer):
    answer = ask(front_server.url, "/viewer/")
    policy = dict(part.split(" ", 1) for part in answer.headers["Content-Security-Policy"].split("; "))
    assert policy["connect-src"] == "'self' data: blob:"
    assert "http" not in answer.headers["Content-Security-Policy"]
    assert ask(front_server.url, "/viewer/re_viewer_bg.wasm", "HEAD").headers["Content-Type"] == "application/wasm"


def test_a_run_s_page_names_changed_fields_by_their_titles(open_another: Callable[..., FrontServer], recorded: Path):
    front_server = open_another()
    logs = front_server.settings.logs
    shutil.copy(recorded, logs / "2026-01-01T00-00-00-x.rrd")
    (logs / "2026-01-01T00-00-00-x.json").write_text('{"changes": ["payload.bending_stiffness: 100 → 50"]}')
    page = ask(front_server.url, "/runs/2026-01-01T00-00-00-x").text
    assert "<li>Bending stiffness EI (N·m²): 100 → 50</li>" in page


def test_a_file_in_the_place_of_the_logs_folder_is_named_as_such(open_another: Callable[..., FrontServer]):
    """The pages said that there was no run yet."""
    front_server = open_another()
    shutil.rmtree(front_server.settings.logs)
    front_server.settings.logs.touch()
    for address in ("/", "/runs"):
        page = ask(front_server.url, address).text
        assert "cannot be read (Not a directory): choose a folder with --logs." in page
        assert "the lab records every run" not in page


def test_a_run_with_gaps_says_how_much_is_missing(open_another: Callable[..., FrontServer], recorded: Path):
    """A lab on a busy machine had left out 37 % of the samples, and its run was "complete" without a word."""
    front_server = open_another()
    path = front_server.settings.logs / "2026-01-01T12-00-00-busy.rrd"
    shutil.copy(recorded, path)
    write_notes(path, rows=63, dropped=37, status="diverged", why_stopped="The payload left its path.")
    for address in ("/runs", f"/runs/{path.stem}"):
        shown = ask(front_server.url, address).text
        assert "37\N{NO-BREAK SPACE}% of the samples are missing" in shown
        assert "The payload left its path." in shown
    write_notes(path, dropped=0)
    assert "are missing" not in ask(front_server.url, f"/runs/{path.stem}").text
