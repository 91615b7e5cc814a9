"""A lab for each visitor: they find it again, nobody else can enter it, and its end harms no other lab."""

import json
import os
import shutil
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from operator import methodcaller
from pathlib import Path

import pytest
from http_client import PATIENCE, ask, looking, upgrade, wait_until
from person import TOKEN, Person, open_server

from flexlab.guide import ClassRules
from flexlab.recording.reader import read_recording
from flexlab.recording.store.notes import write_notes
from flexlab.recording.store.run_files import list_runs, run_state
from flexlab.server.front_server import FrontServer
from flexlab.server.labs import per_visitor


@pytest.fixture(scope="module", autouse=True)
def _patience() -> Iterator[None]:
    """Give labs time to report and to close on a busy machine; other tests check that a hanging lab is killed."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("STOP_TIME", "SILENCE", "SILENT_AT_CLOSING"):
            patch.setattr(per_visitor, name, PATIENCE)
        yield


@pytest.fixture(scope="module")
def private(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FrontServer]:
    """A server with private labs."""
    with open_server(tmp_path_factory.mktemp("private"), private=True, max_sessions=3, rerun=True) as opened:
        yield opened


@pytest.fixture
def torn(recorded: Path, tmp_path: Path) -> Path:
    """The file that a lab leaves if it dies while it records."""
    path = tmp_path / "2026-01-01T12-00-00-begun.rrd"
    data = recorded.read_bytes()
    path.write_bytes(data[: int(0.9 * len(data))])
    return path


def test_two_visitors_do_not_disturb_each_other_even_if_one_lab_dies(private: FrontServer, torn: Path):
    anna, ben = Person(private, ""), Person(private, "")
    first, second = anna.enter(), ben.enter("/lab/soft-beam")
    assert first != second
    assert anna.place.process.pid not in (ben.place.process.pid, os.getpid())
    assert anna.enter() == first, "whoever comes back finds their lab again"
    assert b'<div id="root">' in anna.ask(first).body
    assert f'data-state="/state{first.rstrip("/")}"' in anna.ask(first).text
    assert anna.ask(first.rstrip("/"), **upgrade()).status == 101

    links = [json.loads(who.state(lab))["live"] for who, lab in ((anna, first), (ben, second))]
    data = [visitor.ask(link).headers["Location"] for visitor, link in zip((anna, ben), links, strict=True)]
    assert data[0] != data[1], "each lab has live data of its own"

    assert ben.ask(first).status == 403
    assert ben.ask(first.rstrip("/"), **upgrade()).status == 403
    assert ask(private.url, first).status == 403
    assert ask(private.url, "/lab", **upgrade()).status == 404
    wait_until(lambda: '"name": "soft-beam"' in ben.state(second), "Ben sees the soft beam")
    assert '"name": "paper"' in anna.state(first)
    assert anna.enter("/lab/gravity") == first
    wait_until(lambda: '"name": "gravity"' in anna.state(first), "Anna's lab shows gravity")
    assert "2 of 3 labs in use" in anna.ask("/").text

    with looking(private.url, first, anna.cookies), looking(private.url, second, ben.cookies):
        run = wait_until(
            lambda: anna.place.status().time > 0.5 and anna.place.status().recording, "Anna's run is recorded"
        )
        wait_until(lambda: len(read_recording(run).samples) > 100, "some of it is on disk")
        for rules in (ClassRules(lesson="Lesson 1: Why does it ring?"), ClassRules()):
            anna.place.send(methodcaller("carry_out", rules))
            lesson = wait_until(lambda: anna.place.status().lesson, "the teacher has opened a lesson")
        ben_before = ben.place.status().time
        # Two runs that the lab has not reported to the server: one just begun, and one still empty.
        begun = Path(shutil.copy(torn, private.settings.logs))
        empty = begun.with_name("2026-01-01T12-00-00-empty.rrd")
        empty.touch()
        # Ctrl-C in a terminal reaches every process, but labs leave closing to the server.
        os.kill(ben.place.process.pid, signal.SIGINT)
        os.kill(anna.place.process.pid, signal.SIGKILL)
        told = wait_until(
            lambda: "ended unexpectedly (ended by signal 9)" in anna.state(first) and anna.state(first), ""
        )
        assert '"open": false' in told
        page = anna.ask(first)
        assert page.status == 410
        assert "your run was kept" in page.text
        assert "Open a new lab" in page.text
        assert ben.ask(first).status == 403, "what became of Anna's lab is not for Ben"
        wait_until(lambda: ben.place.status().time > ben_before + 0.5, "Ben's lab runs on")
    assert ben.enter() == second
    wait_until(lambda: run_state(run) == "recovered", "Anna's run is made whole")
    assert len(read_recording(run).samples) > 100
    wait_until(lambda: run_state(begun) == "recovered" and not empty.exists(), "so is what she had just begun")
    assert anna.enter() not in (first, second), "Anna gets a new lab"
    wait_until(lambda: anna.place.status().lesson == lesson, "with the lesson that was open")
    assert [progress.lesson for progress in anna.place.status().lessons] == ["Lesson 1: Why does it ring?"]


def test_a_lesson_goes_on_after_the_server_was_started_again(open_another: Callable[..., FrontServer]):
    before, name = open_another(private=True), "Lesson 1: Why does it ring?"
    anna = Person(before, "")
    anna.enter()
    for rules in (ClassRules(lesson=name), ClassRules()):
        anna.place.send(methodcaller("carry_out", rules))
        lesson = wait_until(lambda: anna.place.status().lesson, "the teacher has opened a lesson")
    before.close()
    [run] = list_runs(before.settings.logs)
    answered = {"lesson": name, "step": 3, "options": ["the motors"], "guess": "the motors", "passed": "It rang."}
    write_notes(run, lessons=[answered])  # As her own page has it noted.
    after = open_another(private=True)
    again = Person(after, "")
    again.cookies = {f"flexlab-visitor-{after.port}": anna.word}
    again.enter()
    wait_until(lambda: again.place.status().lesson == lesson.partition(": ")[0] + ": done", "the lesson is open")
    [progress] = again.place.status().lessons
    assert (progress.lesson, progress.step, progress.guess, progress.passed) == (name, 3, "the motors", "It rang.")
    other = Person(after, "")
    other.enter()
    assert (other.place.status().lesson, other.place.status().lessons) == ("", ())


def test_a_name_and_a_preset_given_while_the_lab_opens_count(
    open_another: Callable[..., FrontServer], monkeypatch: pytest.MonkeyPatch
):
    private = open_another(private=True)
    carla, given, wait = Person(private, ""), threading.Event(), per_visitor.PrivateLab.wait_until_ready
    carla.post("/name", ("name", "Carl"))
    monkeypatch.setattr(
        per_visitor.PrivateLab, "wait_until_ready", lambda place: wait(place) if given.wait(PATIENCE) else 0
    )
    with ThreadPoolExecutor() as pages:
        first = pages.submit(carla.enter)
        wait_until(lambda: carla.word in private.places._opening, "the lab is opening")
        second = pages.submit(carla.enter, "/lab/gravity")
        carla.post("/name", ("name", "Carla"))
        given.set()
        assert first.result() == second.result()
    wait_until(lambda: carla.place.name == "Carla", "the lab has the name")
    wait_until(lambda: '"name": "gravity"' in carla.state(first.result()), "it shows the preset chosen last")


def test_a_full_server_says_so_and_a_lab_that_nobody_watches_makes_room(open_another: Callable[..., FrontServer]):
    front_server = open_another(private=True, max_sessions=1, idle_time=3.0)
    anna, ben = Person(front_server, ""), Person(front_server, "")
    assert anna.ask("/lab/", Sec_Fetch_Dest="image").status == 403, "a foreign page cannot take labs unseen"
    path = anna.enter()
    full = ben.ask("/lab/")
    assert full.status == 503
    assert "No lab is free: 1 of 1 are taken" in full.text
    wait_until(lambda: "closed after 3 s" in anna.state(path), "the idle lab is closed")
    (run,) = list_runs(front_server.settings.logs)
    wait_until(lambda: run_state(run) == "complete", "its run is kept whole")
    assert read_recording(run).status.text
    assert ben.enter() != path


def test_a_browser_that_blocks_cookies_is_told_why_it_gets_no_lab(
    open_another: Callable[..., FrontServer], guarded: FrontServer
):
    """It got a new lab at each attempt, and none of them was its own; a token was asked for again and again."""
    front_server = open_another(private=True, max_sessions=1)
    path = ask(front_server.url, "/lab/").headers["Location"]
    told = ask(front_server.url, path)
    assert (told.status, "This browser sent no cookie" in told.text) == (403, True)
    other = Person(front_server, "")
    other.post("/name", ("name", "Ben"))
    assert "cookie" not in other.ask(path).text
    to = ask(guarded.url, f"/runs?token={TOKEN}").headers["Location"]
    assert "This browser sent no cookie" in ask(guarded.url, to).text


def test_closing_the_server_closes_every_lab_and_keeps_the_runs(tmp_path: Path):
    front_server = open_server(tmp_path, private=True)
    visitor = Person(front_server, "")
    visitor.enter()
    pid = visitor.place.process.pid
    wait_until(lambda: visitor.place.status().recording, "a recording")
    last = front_server.close()
    (run,) = list_runs(tmp_path)
    assert last == run
    assert run_state(run) == "complete"
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
