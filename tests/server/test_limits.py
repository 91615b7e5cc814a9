"""Limits on a visitor and on an address: tasks, files, pages, viewers, places in the line, and disk space for runs."""

import asyncio
import contextlib
import os
import re
import shutil
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from urllib.parse import urlencode

import pytest
from http_client import FORM, ask, file_form, looking, upgrade, upload, wait_until
from person import TEACHER, TOKEN, Person, open_server
from waiting import PATIENCE

from flexlab.errors import RecordingError
from flexlab.presets import load_preset
from flexlab.recording.export import export_recording
from flexlab.recording.file_sink import SPACE_FULL
from flexlab.recording.reader import read_recording
from flexlab.recording.recorder import Recorder
from flexlab.recording.repair import finish
from flexlab.recording.store.notes import write_notes
from flexlab.recording.store.run_files import has_footer, list_runs
from flexlab.recording.store.run_index import list_rows, state_word
from flexlab.server.front_server import FrontServer
from flexlab.server.labs import MOST_OF_ADDRESS, FullError, WaitingLine
from flexlab.server.limits import (
    LOOK,
    LOOK_AGAIN,
    THE_SERVER,
    BusyError,
    Limit,
    Quota,
    Visitor,
    for_teacher,
)
from flexlab.server.pages import run_actions, runs_pages
from flexlab.server.run_jobs import take_in
from flexlab.server.tasks import AT_ONCE, MOST_OF_ONE, Turns
from flexlab.server.visitors import MOST_PAGES, MOST_VIEWERS
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FrontServer]:
    """A class with private labs, live data and a quota."""
    tokens, limits = (
        {"token": TOKEN, "teacher_token": TEACHER},
        {"max_sessions": 3, "max_per_address": 3, "quota": 20.0},
    )
    with open_server(tmp_path_factory.mktemp("class"), private=True, rerun=True, **tokens, **limits) as opened:
        yield opened


def runs_of(server: FrontServer, person: Person, recorded: Path, count: int) -> list[str]:
    """Copy `count` runs into a person's library and return their ids."""
    paths = [server.settings.logs / f"2025-02-0{k + 1}T12-00-00-{person.owner[:6]}.rrd" for k in range(count)]
    for path in paths:
        shutil.copy(recorded, path)
        shutil.copy(recorded.with_suffix(".json"), path.with_suffix(".json"))
        write_notes(path, owner=person.owner)
    return [path.stem for path in paths]


def head_of(person: Person, line: str, **more: str) -> bytes:
    cookies = "; ".join(f"{name}={value}" for name, value in person.cookies.items())
    fields = {"Host": f"127.0.0.1:{person.server.port}", "Cookie": cookies, **more}
    lines = "".join(f"{name.replace('_', '-')}: {value}\r\n" for name, value in fields.items())
    return f"{line} HTTP/1.1\r\n{lines}\r\n".encode()


def files_in(server: FrontServer) -> list[Path]:
    return [path for path in server.temporary_folder.rglob("*") if path.parent.name.startswith("file-")]


def test_a_limit_bounds_a_visitor_an_address_and_all_and_keeps_a_place_for_the_teacher():
    limit = Limit("things", 2, 3, 4, 1)
    people = [Visitor("a", "1"), Visitor("a", "2"), Visitor("b", "1"), Visitor("c", "1"), Visitor("d", "3")]
    with contextlib.ExitStack() as held:
        held.enter_context(limit.place(people[0]))
        held.enter_context(limit.place(people[1]))
        with pytest.raises(BusyError, match="You have 2 things already, and may have 2"):
            limit.check(people[0])
        held.enter_context(limit.place(people[2]))
        held.enter_context(limit.place(Visitor("", "1")))
        with pytest.raises(BusyError, match="Your address has 3 things"):
            limit.check(people[3])
        with pytest.raises(BusyError, match="This server has 4 things"):
            limit.check(people[4])
        held.enter_context(limit.place(THE_SERVER))
        with pytest.raises(BusyError, match="This server has 5"):
            limit.check(THE_SERVER)
    limit.check(people[0])


def test_turns_go_to_the_teacher_first_and_to_each_visitor_one_at_a_time():
    order: list[str] = []

    async def work(turns: Turns, name: str, asker: Visitor, over: asyncio.Event, shown: bool = False) -> None:
        async with turns.turn(asker, shown=shown):
            order.append(name)
            await over.wait()

    async def wait_for_replays() -> None:
        turns, over = Turns(), asyncio.Event()
        people = {"greedy": Visitor("g", "1"), "near": Visitor("n", "1"), "far": Visitor("f", "2")}
        replays = [work(turns, f"{name}'s replay", person, over, shown=True) for name, person in people.items()]
        again = work(turns, "greedy's second replay", people["greedy"], over, shown=True)
        imports = [work(turns, f"greedy's import {k}", people["greedy"], over) for k in range(2)]
        tasks = [asyncio.create_task(each) for each in (*replays, again, *imports)]
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert sorted(order) == ["greedy's import 0", "greedy's replay", "near's replay"]
        over.set()
        await asyncio.gather(*tasks)
        order.clear()

    async def play() -> None:
        turns, over = Turns(), asyncio.Event()
        greedy = [work(turns, f"greedy-{k}", Visitor("g", "1"), over) for k in range(3)]
        others = [work(turns, "near", Visitor("n", "1"), over), work(turns, "far", Visitor("f", "2"), over)]
        tasks = [asyncio.create_task(each) for each in (*greedy, *others)]
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert len(order) == AT_ONCE - 1
        assert order[0] == "greedy-0"
        tasks.append(asyncio.create_task(work(turns, "teacher", Visitor("t", "1", True), over)))
        for _ in range(3):
            await asyncio.sleep(0)
        assert order[-1] == "teacher", "a turn is kept for who teaches"
        tasks[1].cancel()
        over.set()
        await asyncio.gather(*tasks, return_exceptions=True)
        assert sorted(order) == ["far", "greedy-0", "greedy-2", "near", "teacher"]
        async with asyncio.timeout(1), turns.turn(Visitor("g", "1")):
            pass  # All turns were given back.

    # Playwright keeps an event loop on this thread.
    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, wait_for_replays()).result()
        thread.submit(asyncio.run, play()).result()


def test_one_address_neither_fills_the_waiting_line_nor_is_served_first():
    line = WaitingLine()
    assert [line.place(f"ghost-{k}", 0, "1") for k in range(MOST_OF_ADDRESS)] == [*range(1, MOST_OF_ADDRESS + 1)]
    for k in range(150):
        with pytest.raises(FullError, match="from your address wait"):
            line.place(f"late-{k}", 0, "1")
    assert line.place("anna", 0, "2") == 2, "after the first one of the other address"
    assert line.place("ben", 0, "3") == 3
    assert line.place("anna", 1, "2") == 2
    assert line.place("ghost-0", 1, "1") == 0
    assert line.place("anna", 2, "2") == 0


def test_one_visitor_cannot_take_all_tasks_and_the_teacher_s_import_goes_on(server: FrontServer, recorded: Path):
    ben, anna, teacher = Person(server), Person(server), Person(server, TEACHER)
    runs = runs_of(server, ben, recorded, 8)
    (annas,) = runs_of(server, anna, recorded, 1)
    answers = [ben.post(f"/runs/{run}/replay") for run in runs]
    assert [answer.status for answer in answers].count(303) <= MOST_OF_ONE + 1, "one may have ended meanwhile"
    assert answers[-1].status == 503
    assert "tasks already" in answers[-1].text
    assert anna.post(f"/runs/{annas}/replay").status == 303
    table = export_recording(read_recording(recorded), server.temporary_folder / "run.npz")
    assert upload(server.url, "run.npz", table.read_bytes(), teacher.cookies).status == 303
    for run in (runs[0], annas):
        person = ben if run in runs else anna
        wait_until(lambda run=run, person=person: '"good"' in person.ask(f"/runs/{run}/replay").text, "it is replayed")


def test_endless_uploads_are_limited_and_leave_no_files(server: FrontServer, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(runs_pages, "UPLOAD_TIME", 2.0)
    ben = Person(server)
    body, kind = file_form("run.csv", b"x" * 1_000_000)
    head = head_of(ben, "POST /runs/import", Content_Type=kind, Content_Length="900000000")
    with contextlib.ExitStack() as closing:
        plugs = [closing.enter_context(socket.create_connection(("127.0.0.1", server.port), 30)) for _ in range(4)]
        for plug in plugs:
            plug.sendall(head + body[:500_000])
        said = [plug.recv(1 << 16) for plug in plugs]
    assert sum(b"files on their way already" in words for words in said) == 2
    assert sum(b"took longer than" in words for words in said) == 2
    wait_until(lambda: not files_in(server), "nothing is left")
    nothing = ben.ask(
        "/runs/import", "POST", b"".join([b"5\r\nhello\r\n0\r\n\r\n"]), Content_Type=kind, Content_Length=""
    )
    assert nothing.status in (400, 422)


def test_an_upload_that_its_visitor_breaks_off_leaves_no_file(server: FrontServer):
    """It was waited for until it was too slow on average, and two of them refused all further uploads for minutes."""
    ben = Person(server)
    body, kind = file_form("run.csv", b"x" * 5_000_000)
    head = head_of(ben, "POST /runs/import", Content_Type=kind, Content_Length=str(len(body)))
    for _ in range(2):
        with socket.create_connection(("127.0.0.1", server.port), 30) as plug:
            plug.sendall(head + body[:-1000])
            wait_until(lambda: files_in(server), "the file is begun")
        wait_until(lambda: not files_in(server), "nothing is left", 20.0)


def test_an_archive_that_nobody_reads_is_removed(server: FrontServer, recorded: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(run_actions, "READING_TIME", 1.0)
    cleo = Person(server)
    (run,) = runs_of(server, cleo, recorded, 1)
    os.truncate(server.settings.logs / f"{run}.rrd", 80_000_000)
    form = urlencode({"run": run, "format": "rrd"})
    head = head_of(cleo, "POST /runs/export", Content_Type=FORM, Content_Length=str(len(form)))
    with socket.socket() as plug:
        plug.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        plug.connect(("127.0.0.1", server.port))
        plug.sendall(head + form.encode())
        wait_until(lambda: files_in(server), "the archive is made")
        wait_until(lambda: not files_in(server), "it goes although nobody read it")
    (server.settings.logs / f"{run}.rrd").unlink()


def test_live_data_are_for_the_lab_s_visitor_and_the_teacher_only(server: FrontServer):
    anna, ben, teacher = Person(server), Person(server), Person(server, TEACHER)
    path = anna.ask("/lab/").headers["Location"].rstrip("/")
    live = f"/live/{path.rpartition('/')[2]}.rrd"
    assert ben.ask(live, "HEAD").status == 404
    assert anna.ask(live, "HEAD").status == 200
    assert teacher.ask(live, "HEAD").status == 200


def test_live_data_need_the_visitor_s_cookie_without_tokens_too(open_another: Callable[..., FrontServer]):
    server = open_another(private=True, rerun=True, max_sessions=2, max_per_address=2)
    answer = ask(server.url, "/lab/")
    live = f"/live/{answer.headers['Location'].split('/')[2]}.rrd"
    assert ask(server.url, live, "HEAD").status == 404
    assert ask(server.url, live, "HEAD", cookies=answer.cookies).status == 200
    shown = ask(server.url, "/live", cookies=answer.cookies).headers["Location"]
    assert re.search(r"/pass/[0-9a-f]{64}/live/", shown)


def test_one_visitor_can_open_only_so_many_pages_and_viewers(server: FrontServer):
    anna = Person(server)
    path = anna.ask("/lab/").headers["Location"].rstrip("/")
    with contextlib.ExitStack() as open_pages:
        for _ in range(MOST_PAGES[0]):
            open_pages.enter_context(looking(server.url, path, anna.cookies))
        assert anna.ask(path, **upgrade()).status == 503
        assert "open pages of labs already" in anna.ask(f"{path}/").text, "rather than a page that never connects"
        assert Person(server, TEACHER).ask(path, **upgrade()).status == 101
    live = f"/live/{path.rpartition('/')[2]}.rrd"
    with contextlib.ExitStack() as closing:
        for _ in range(MOST_VIEWERS[0]):
            plug = closing.enter_context(socket.create_connection(("127.0.0.1", server.port), 30))
            plug.sendall(head_of(anna, f"GET {live}"))
            assert plug.recv(12) == b"HTTP/1.1 200"
        assert anna.ask(live, "HEAD").status == 503
    wait_until(lambda: anna.ask(live, "HEAD").status == 200, "a place is free again")


def test_a_quota_holds_when_a_lab_is_closed(tmp_path: Path):
    most, owner = 5e6, Visitor("anna").owner
    told: list[str] = []
    recorder = Recorder(
        tmp_path, on_problem=told.append, circumstances=lambda: {"owner": owner}, refusal=Quota(tmp_path, owner, most)
    )
    run = simulate(load_preset("paper"), duration=30.0, sample_period=0.001)
    for number in range(3):
        recorder.begin_run(number, "paper", run.scenario, World(run.scenario).state())
        for first in range(0, len(run), 500):
            take = partial(recorder.take_samples, number, run.slice(first, first + 500), 1.0)
            wait_until(lambda take=take: take() == 0, "there is room")
        recorder.end_run(number, run.status)
    recorder.close(finishing_time=PATIENCE)
    assert told
    assert [sentence for sentence in told if "of the 5 MB that each visitor has" not in sentence] == []
    written = sum(path.stat().st_size for path in list_runs(tmp_path))
    assert 3e6 < written <= most
    cut = [row for row in list_rows(tmp_path) if row.breaks_off]
    assert {(row.breaks_off, row.state, state_word(row)) for row in cut} == {(SPACE_FULL, "recovered", "breaks off")}


def test_the_quota_counts_in_advance_what_finishing_adds_to_a_run(tmp_path: Path):
    owner, run = Visitor("anna").owner, simulate(load_preset("paper"), duration=0.1)
    recorder = Recorder(tmp_path, circumstances=lambda: {"owner": owner})
    recorder.begin_run(1, "paper", run.scenario, World(run.scenario).state())
    recorder.take_samples(1, run.slice(0, len(run)), 1.0)
    recorder.close(finishing_time=0.0)
    (path,) = list_runs(tmp_path)
    assert not has_footer(path)
    most = path.stat().st_size + 50_000
    now = [0.0]
    quota = Quota(tmp_path, owner, most, clock=lambda: now[0])
    assert "that each visitor has: delete" in quota(1000), "nobody wants to read that this needs 0.0 MB"
    finish(path)
    assert path.stat().st_size > most
    path.unlink()
    assert quota(1000), "it was looked at just now"
    now[0] = LOOK_AGAIN
    assert not quota(1000)


def test_an_import_beside_a_lab_that_records_stays_within_the_quota(tmp_path: Path, recorded: Path):
    logs, owner, over = tmp_path / "logs", Visitor("anna").owner, threading.Event()
    logs.mkdir()
    uploaded = Path(shutil.copy(recorded, tmp_path))
    most = recorded.stat().st_size + 2_500_000
    grown, block = logs / "2025-02-01T12-00-00-paper.rrd", 50_000
    write_notes(grown, owner=owner)
    grown.write_bytes(b"x" * block)
    begun, refused = threading.Event(), threading.Event()

    def record() -> None:
        quota = Quota(logs, owner, most)
        with grown.open("ab", buffering=0) as file:
            while not over.wait(0.05):
                if quota(block):
                    refused.set()
                else:
                    file.write(b"x" * block)
                begun.set()

    with ThreadPoolExecutor(1) as thread:
        recording = thread.submit(record)
        try:
            begun.wait()
            with contextlib.suppress(RecordingError):
                take_in(uploaded, logs, {"owner": owner}, most)
            refused.wait()
        finally:
            over.set()
        recording.result()
    assert grown.stat().st_size > block
    assert sum(path.stat().st_size for path in logs.iterdir()) <= most


def test_notes_beside_runs_count_for_the_quota(tmp_path: Path, recorded: Path):
    run, owner, now = Path(shutil.copy(recorded, tmp_path)), Visitor("anna").owner, [0.0]
    quota = Quota(tmp_path, owner, run.stat().st_size + 300_000, clock=lambda: now[0])
    assert not quota(200_000), "a run that is just being opened has no owner yet"
    write_notes(run, owner=owner)
    now[0] = LOOK
    assert not quota(200_000)
    write_notes(run, note="n" * 200_000)
    now[0] = 2 * LOOK
    assert "that each visitor has, and this needs 0.2 MB: delete" in quota(200_000)
    told = Quota(tmp_path, owner, 1e5)(200_000)
    assert "of the 0 MB that each visitor has: delete" in told, "they take more already"
    assert for_teacher(told).startswith(told.partition(":")[0].replace("Your", "Their"))


def test_imports_count_for_the_quota(server: FrontServer, recorded: Path):
    dora = Person(server)
    (run,) = runs_of(server, dora, recorded, 1)
    os.truncate(server.settings.logs / f"{run}.rrd", 20_000_000 - recorded.stat().st_size // 2)
    before = {path.name for path in server.settings.logs.iterdir()}
    table = export_recording(read_recording(recorded), server.temporary_folder / "run2.npz")
    for name, content in (("more.rrd", recorded.read_bytes()), ("more.npz", table.read_bytes())):
        refused = upload(server.url, name, content, dora.cookies)
        assert refused.status == 422
        assert "of the 20\N{NO-BREAK SPACE}MB that each visitor has" in refused.text
    assert {path.name for path in server.settings.logs.iterdir()} == before
    (server.settings.logs / f"{run}.rrd").unlink()
    assert upload(server.url, "more.rrd", recorded.read_bytes(), dora.cookies).status == 303


def test_an_import_without_a_cookie_is_refused(tmp_path: Path, recorded: Path):
    """Each such import came with a new cookie, and so with a new quota."""
    with open_server(tmp_path, token=TOKEN, teacher_token=TEACHER, private=True) as opened:
        emil = Person(opened)
        del emil.cookies[f"flexlab-visitor-{opened.port}"]  # The browser forgot it while the page Runs stood open.
        form, boundary = file_form("mine.rrd", recorded.read_bytes())
        refused = emil.ask("/runs/import", "POST", form, Content_Type=boundary)
        assert (refused.status, "Open the page Runs again" in refused.text) == (422, True)
        emil.ask("/runs")
        taken = emil.ask("/runs/import", "POST", form, Content_Type=boundary)
        assert emil.ask(taken.headers["Location"]).status == 200
