"""A class: who is the teacher, whose runs are whose, who waits for a lab, what the teacher's page shows and does."""

import json
import os
import re
import shutil
import zipfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import pytest
from http_client import ask, looking, wait_until
from person import TEACHER, TOKEN, Person, open_server

from flexlab.recording.store import run_index
from flexlab.recording.store.notes import read_notes, write_notes
from flexlab.recording.store.people import names_told_apart
from flexlab.recording.store.run_index import read_row
from flexlab.server.front_server import FrontServer
from flexlab.server.visitors import checked_name

QUOTA = 50_000_000
"""Bytes; more than any lab of these tests records."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FrontServer]:
    """A class with one private lab."""
    tokens, limits = {"token": TOKEN, "teacher_token": TEACHER}, {"max_sessions": 1, "quota": QUOTA / 1e6}
    with open_server(tmp_path_factory.mktemp("class"), private=True, **tokens, **limits) as opened:
        yield opened


@pytest.fixture(scope="module")
def teacher(server: FrontServer) -> Person:
    return Person(server, TEACHER)


@pytest.fixture(scope="module")
def anna(server: FrontServer) -> Person:
    """A student with a name and a lab."""
    person = Person(server)
    assert person.post("/name", ("name", " Anna <b>"), ("enter", "yes")).headers["Location"] == "/lab/"
    return person


@pytest.fixture(scope="module")
def ben(server: FrontServer) -> Person:
    """A student without a lab."""
    person = Person(server)
    person.post("/name", ("name", "Ben"))
    return person


@pytest.fixture
def runs(server: FrontServer, recorded: Path, anna: Person, ben: Person) -> Iterator[dict[str, str]]:
    """A run of Anna's, two of Ben's, and one of nobody's: whose → id."""
    owners = {"anna": anna.owner, "ben": ben.owner, "ben-too": ben.owner, "nobody": ""}
    paths = {whose: server.settings.logs / f"2025-01-01T12-00-0{k}-{whose}.rrd" for k, whose in enumerate(owners)}
    for whose, path in paths.items():
        shutil.copy(recorded, path)
        shutil.copy(recorded.with_suffix(".json"), path.with_suffix(".json"))
        write_notes(path, owner=owners[whose], visitor=whose.title())
    yield {whose: path.stem for whose, path in paths.items()}
    for path in paths.values():
        path.unlink(missing_ok=True)
        path.with_suffix(".json").unlink(missing_ok=True)


@pytest.mark.parametrize("path", ["/teacher", "/teacher/labs"])
def test_the_teacher_s_page_opens_with_the_teacher_s_token_only(
    server: FrontServer, teacher: Person, ben: Person, path: str
):
    assert teacher.ask(path).status == 200
    assert ben.ask(path).status in (401, 403)
    assert ask(server.url, path).status == 401
    assert ask(server.url, path, cookies={f"flexlab-teacher-{server.port}": TOKEN}).status == 401
    assert ask(server.url, path, cookies={f"flexlab-teacher-{server.port}": "ä"}).status == 401


@pytest.mark.parametrize("path", ["/teacher/send", "/teacher/pause", "/teacher/resume"])
def test_orders_to_labs_need_the_teacher_s_token_and_the_teacher_s_own_page(teacher: Person, ben: Person, path: str):
    assert ben.post(path, ("preset", "gravity")).status == 403
    assert teacher.post(path, ("preset", "gravity"), Origin="http://evil.example").status == 403
    assert teacher.post(path, ("preset", "../paper"), ("lab", "/s/none")).status == 400


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("x" * 41, "at most 40 fit"),
        ("e\u0301" * 300, "has 600 characters"),
        ("a\x07b", "control characters"),
        ("a\u202eb", "control characters"),
        ("A\u200cnna", "control characters"),
        ("علی\u200c", "control characters"),
        ("علی\u200c\u200cرضا", "control characters"),
    ],
)
def test_a_name_that_is_too_long_or_has_control_characters_is_refused(ben: Person, name: str, said: str):
    answer = ben.post("/name", ("name", name))
    assert answer.status == 400
    assert said in answer.text


@pytest.mark.parametrize("name", ["علی\u200cرضا", "ශ්\u200dරී", "क्\u200dष", "O’Neil-Ødegård", "李雷"])
def test_names_of_all_scripts_are_names(name: str):
    """Persian and Sinhala names contain characters that keep letters apart or join them: they were refused."""
    assert checked_name(f" {name} ") == name
    assert names_told_apart([(name, "aaaaaa"), (name.replace("\u200c", ""), "bbbbbb")], Path("none"))[
        name, "aaaaaa"
    ] == (f"{name} (aaaa)")


def test_a_name_stays_in_the_browser_and_is_escaped(anna: Person):
    assert 'value="Anna &lt;b&gt;"' in anna.ask("/").text


def test_visitors_wait_in_line_and_the_teacher_leads_the_one_lab(server: FrontServer, teacher: Person, anna: Person):
    path = anna.ask("/lab/").headers["Location"]
    cleo, dora = Person(server), Person(server)
    places = [cleo.ask("/lab/"), dora.ask("/lab/"), cleo.ask("/lab/")]
    for place, answer in zip(("1 of 1", "2 of 2", "1 of 2"), places, strict=True):
        assert (answer.status, answer.headers["Refresh"]) == (503, "5; url=/lab/")
        assert f"You are number {place} in line" in answer.text
    assert cleo.ask(path).status == 403
    assert teacher.ask(path).status == 200, "the teacher joins"
    with looking(server.url, path.rstrip("/"), anna.cookies):
        (lab,) = wait_until(lambda: (labs := teacher.labs())[0]["time"] > 0.2 and labs, "it runs")
        assert (lab["who"], lab["preset"], lab["state"], lab["watching"]) == ("Anna <b>", "paper", "running", 1)
        assert 0 < lab["error"] < 100, "mm"
        told = teacher.post("/teacher/pause", Accept="application/json")
        assert json.loads(told.text)["sentence"] == "1 lab paused."
        wait_until(lambda: teacher.labs()[0]["state"] == "paused", "it pauses")
        teacher.post("/teacher/resume", ("lab", path.rstrip("/")))
        wait_until(lambda: teacher.labs()[0]["state"] == "running", "it goes on")
        assert teacher.post("/teacher/send", ("preset", "soft-beam")).status == 303
        wait_until(lambda: teacher.labs()[0]["preset"] == "soft-beam", "the preset comes")
        run = wait_until(lambda: server.places.running()[0].status().recording, "it is recorded")
        notes = wait_until(lambda: read_notes(run), "whose it is stands there from the beginning")
        assert (notes["owner"], notes["visitor"]) == (anna.owner, "Anna <b>")


def test_a_page_that_waits_after_a_form_goes_on_at_an_address_that_takes_it(
    anna: Person, ben: Person, runs: dict[str, str]
):
    """It asked for the form's own address, by GET: instead of a lab it got the page for a wrong method."""
    anna.enter()
    waiting = ben.post(f"/runs/{runs['ben']}/continue", ("time", ""))
    assert (waiting.status, waiting.headers["Refresh"]) == (503, "5; url=/lab/")
    assert ben.ask("/lab/").status == 503, "there Ben stands in line"


def test_two_students_of_one_name_are_told_apart(tmp_path: Path, recorded: Path):
    room = {"max_sessions": 2, "max_per_address": 2}
    with open_server(tmp_path, token=TOKEN, teacher_token=TEACHER, private=True, **room) as opened:
        teacher, students = Person(opened, TEACHER), [Person(opened), Person(opened)]
        for number, student in enumerate(students):
            student.post("/name", ("name", "Anna"))
            student.enter()
            if number == 0:
                assert [lab["who"] for lab in teacher.labs()] == ["Anna"], "alone she needs no mark"
            run = Path(shutil.copy(recorded, tmp_path / f"2025-01-01T12-00-0{number}-paper.rrd"))
            write_notes(run, owner=student.owner, visitor="Anna")
        names = [f"Anna ({student.owner[:4]})" for student in students]
        assert [lab["who"] for lab in teacher.labs()] == names
        table = teacher.ask("/runs").text
        assert all(f'<span class="by">{name}</span>' in table for name in names)
        assert '<span class="by">Anna</span>' in students[0].ask("/runs").text, "she sees none but her own"
        ids = [f"2025-01-01T12-00-0{number}-paper" for number in range(2)]
        question = teacher.ask(f"/runs/delete?run={ids[0]}&run={ids[1]}").text
        place = teacher.ask(f"/compare?run={ids[0]}&run={ids[1]}").headers["Location"]
        comparison, key = teacher.ask(place).text, place.rpartition("&of=")[2]
        assert [person.ask(f"/compare/{key}/state").status for person in (teacher, students[0])] == [200, 404]
        other = Path(shutil.copy(recorded, tmp_path / "2025-01-01T12-00-03-paper.rrd")).stem
        answer = teacher.ask(f"/compare?run={ids[0]}&run={other}&of={key}")
        assert (answer.status, key in answer.headers.get("Location", key)) == (303, False), "the table is of other runs"
        for name, run, student in zip(names, ids, students, strict=True):
            assert f" · {name}" in teacher.ask(f"/runs/{run}").text
            assert f", {name}</li>" in question
            assert f" · {name}</span>" in comparison
            assert " · Anna</p>" in student.ask(f"/runs/{run}").text, "she sees none but her own"
            sheet = student.ask(f"/runs/{run}/export?format=html").text
            assert f" · {name}" in sheet, "she hands it in where others hand in theirs"
        students[1].post("/name", ("name", "Anna B."))
        assert [lab["who"] for lab in teacher.labs()] == [names[0], "Anna B."], "runs of another Anna lie there"


def test_recording_stops_at_the_quota_and_goes_on_once_runs_are_deleted(
    server: FrontServer, teacher: Person, anna: Person, runs: dict[str, str]
):
    def enlarge(whose: str) -> None:
        os.truncate(server.settings.logs / f"{runs[whose]}.rrd", 60_000_000)

    def problem() -> str:
        return teacher.labs()[0]["problem"]

    path = anna.ask("/lab/").headers["Location"].rstrip("/")
    enlarge("ben")  # The runs of others do not count.
    enlarge("anna")
    with looking(server.url, path, anna.cookies):
        wait_until(lambda: teacher.labs()[0]["watching"], "she looks, as otherwise nothing is resumed")
        teacher.post("/teacher/resume", ("lab", path))
        lab = server.places.running()[0]
        # The megabytes depend on how long her lab has recorded by now.
        told = r"Your runs take \d+ MB of the 50 MB that each visitor has: delete some of them"
        wait_until(lambda: re.search(told, lab.status().problem), "she is told")
        kept = r"Their runs take \d+ MB of the 50 MB that each visitor has: nothing more is recorded until some are deleted\."
        assert re.fullmatch(kept, problem()), "what to do is hers to read"
        recording = server.places.running()[0].status().recording
        assert recording is not None
        size = recording.stat().st_size
        seen = teacher.labs()[0]["time"]
        wait_until(lambda: teacher.labs()[0]["time"] > seen + 0.5, "the simulation goes on")
        assert recording.stat().st_size == size, "nothing more is recorded"
        assert anna.post("/runs/delete", ("run", runs["anna"]), ("sure", "yes")).status == 303
        wait_until(lambda: not problem(), "all is well again")
        wait_until(lambda: recording.stat().st_size > size, "it is recorded again")


def test_only_the_teacher_has_a_link_to_the_class_on_every_page(teacher: Person, anna: Person):
    for path in ("/", "/runs", "/studies", "/no-such-page"):
        assert '<a href="/teacher"' in teacher.ask(path).text.partition("</header>")[0]
        assert "/teacher" not in anna.ask(path).text


def test_the_teacher_of_a_shared_lab_on_loopback_has_a_link_to_the_class_too(tmp_path: Path):
    with open_server(tmp_path, token=TOKEN, teacher_token=TEACHER) as opened:
        heads = [Person(opened, token).ask("/").text.partition("</header>")[0] for token in (TEACHER, TOKEN)]
    assert ['<a href="/teacher"' in head for head in heads] == [True, False]


def test_students_see_their_own_runs_and_the_teacher_sees_all(
    teacher: Person, anna: Person, ben: Person, runs: dict[str, str], monkeypatch: pytest.MonkeyPatch
):
    for person, own in ((anna, ["anna"]), (ben, ["ben", "ben-too"]), (teacher, list(runs))):
        library = person.ask("/runs").text
        assert [whose for whose in runs if f'value="{runs[whose]}"' in library] == own
    looks: list[Path] = []
    monkeypatch.setattr(run_index, "read_row", lambda path: looks.append(path) or read_row(path))
    start = anna.ask("/").text
    assert (runs["anna"] in start, runs["ben"] in start) == (True, False)
    looked_at = {whose for whose, run in runs.items() if run in {path.stem for path in looks}}
    assert looked_at == {"anna"}, "a look at all of 10,000 runs took four seconds"
    made_up = Person(anna.server)
    unsigned = f"{anna.word.partition('.')[0]}.{'0' * 40}"
    made_up.cookies[f"flexlab-visitor-{anna.server.port}"] = unsigned
    made_up.ask("/")
    assert made_up.word != unsigned, "who brings a word that the server has not signed gets another"


@pytest.mark.parametrize("path", ["/{}", "/{}.rrd", "/delete?run={}", "/{}/export?format=csv", "/{}/replay"])
def test_a_student_cannot_open_a_run_of_somebody_else(anna: Person, runs: dict[str, str], path: str):
    for whose in ("ben", "nobody"):
        answer = anna.ask("/runs" + path.format(runs[whose]))
        assert answer.status in (400, 404)
        assert "There is no run" in answer.text
    assert anna.ask(f"/compare?run={runs['anna']}&run={runs['ben']}").status == 404


@pytest.mark.parametrize("action", ["notes", "continue", "replay"])
def test_a_student_cannot_change_or_use_a_run_of_somebody_else(anna: Person, runs: dict[str, str], action: str):
    answer = anna.post(f"/runs/{runs['ben']}/{action}", ("note", "mine now"))
    assert (answer.status, "There is no run" in answer.text) == (404, True)
    for bulk in ("tag", "export", "delete"):
        fields = ("run", runs["ben"]), ("tags", "mine"), ("format", "rrd"), ("sure", "yes")
        answer = anna.post(f"/runs/{bulk}", *fields)
        assert (answer.status, "There is no run" in answer.text) == (404, True)


def test_a_pass_to_one_s_own_run_opens_no_other_run(server: FrontServer, anna: Person, runs: dict[str, str]):
    found = re.search(r'data-recording="(/pass/[0-9a-f]{64}/[^"]+)"', anna.ask(f"/runs/{runs['anna']}").text)
    assert found
    own = found[1]
    assert ask(server.url, own).status == 200
    other = own.replace(runs["anna"], runs["ben"])
    assert ask(server.url, other).status == 401
    assert anna.ask(other).status == 404


def test_runs_are_tagged_exported_and_deleted_in_bulk(server: FrontServer, ben: Person, runs: dict[str, str]):
    mine = [("run", runs[whose]) for whose in ("ben", "ben-too")]
    assert ben.post("/runs/tag", *mine, ("tags", "first, <i>")).status == 303
    assert ben.ask("/runs").text.count('<span class="tag">first</span> <span class="tag">&lt;i&gt;</span>') == 2
    archive = zipfile.ZipFile(BytesIO(ben.post("/runs/export", *mine, ("format", "rrd")).body))
    assert sorted(archive.namelist()) == sorted(f"{run}{end}" for _, run in mine for end in (".json", ".rrd"))
    write_notes(server.settings.logs / f"{runs['ben-too']}.rrd", keep=True)
    asked = ben.post("/runs/delete", *mine).text
    assert "Delete this run?" in asked
    assert "is marked to be kept" in asked
    assert all((server.settings.logs / f"{run}.rrd").exists() for _, run in mine), "it asks first"
    answer = ben.post("/runs/delete", *mine, ("sure", "yes"))
    assert (answer.status, "1 of 2 runs were deleted" in answer.text) == (409, True)
    assert [(server.settings.logs / f"{run}.rrd").exists() for _, run in mine] == [False, True]
    assert ben.post("/runs/delete").status == 400
    assert ben.post("/runs/delete", ("run", "none")).status == 404


@pytest.mark.parametrize("private", [True, False])
def test_the_teacher_s_rules_hold_after_a_restart(tmp_path: Path, private: bool):
    settings = {"token": TOKEN, "teacher_token": TEACHER, "private": private}
    lesson = "Lesson 1: Why does it ring?"
    with open_server(tmp_path, **settings) as server:
        asked = [("lesson", lesson), ("step", "2"), ("lock", "on"), ("hide", "on")]
        assert Person(server, TEACHER).post("/teacher/rules", *asked).status == 303
    with open_server(tmp_path, **settings) as server:
        rules = json.loads(Person(server, TEACHER).ask("/teacher/labs").text)["rules"]
        assert rules == {"lesson": lesson, "step": "2", "lock": True, "hide": True}
        if not private:
            wait_until(lambda: Person(server, TEACHER).labs()[0]["state"] == "paused", "nobody can play")
    gone = {"step": 2, "lesson": "Own lesson: since deleted", "locked": True}
    (tmp_path / ".class.json").write_text(json.dumps({"rules": gone}))
    with open_server(tmp_path, **settings) as server:
        rules = json.loads(Person(server, TEACHER).ask("/teacher/labs").text)["rules"]
        assert rules == {"lesson": "", "step": "3", "lock": True, "hide": False}, (
            "the class waits at no lesson that is gone"
        )
    (tmp_path / ".class.json").write_text('{"rules": {"step": 99, "lesson": 3}}')
    with open_server(tmp_path, **settings) as server:
        rules = json.loads(Person(server, TEACHER).ask("/teacher/labs").text)["rules"]
        assert rules == {"lesson": "", "step": "3", "lock": False, "hide": False}
