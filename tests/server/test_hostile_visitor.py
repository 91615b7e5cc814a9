"""Hostile visitors to the front server: the lab goes on, others get in, and the answer says what was wrong."""

import contextlib
import json
import logging
import os
import shutil
import signal
import socket
import struct
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from fuzz import Attack
from http_client import FORM, Answer, ask, looking, upgrade, wait_until
from person import TOKEN, Person

from flexlab.errors import PresetError, RecordingError
from flexlab.lab.panel.scenario_files import MOST_PRESETS, save_preset
from flexlab.presets import load_preset
from flexlab.recording.reader import read_recording
from flexlab.recording.store.run_files import run_state
from flexlab.recording.store.run_index import annotate_run, find_row
from flexlab.server import connections
from flexlab.server.front_server import LOCK, FrontServer, remove_left, temporary_folder
from flexlab.server.labs import per_visitor
from flexlab.server.limits import FREE
from flexlab.text import visible


def plug_to(front_server: FrontServer) -> socket.socket:
    return socket.create_connection(("127.0.0.1", front_server.port), timeout=30)


def is_closed(plug: socket.socket) -> bool:
    plug.setblocking(False)
    try:
        return plug.recv(1 << 16) == b""
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


def a_fresh_visitor_sees_a_moving_lab(front_server: FrontServer, cookies: dict[str, str] | None = None) -> None:
    (place,) = front_server.places.running()
    assert ask(front_server.url, "/lab", cookies=cookies, **upgrade()).status == 101
    before = place.status().time
    with looking(front_server.url, "/lab", cookies):
        wait_until(lambda: place.status().time > before, "time goes on")


def test_idle_connections_make_room_for_visitors_with_the_token(open_another: Callable[..., FrontServer]):
    front_server = open_another(token=TOKEN)
    cookies = ask(front_server.url, f"/?token={TOKEN}").cookies
    with contextlib.ExitStack() as closing:
        plugs = [closing.enter_context(plug_to(front_server)) for _ in range(connections.MOST_RESTING_PER_ADDRESS + 30)]
        assert ask(front_server.url, "/", cookies=cookies).status == 200
        a_fresh_visitor_sees_a_moving_lab(front_server, cookies)
        wait_until(lambda: sum(map(is_closed, plugs)) >= 30, "the oldest were closed")


def test_slow_heads_and_bodies_are_closed(open_another: Callable[..., FrontServer], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(connections, "HEAD_TIME", 1.0)
    monkeypatch.setattr(connections, "BODY_TIME", 1.0)
    front_server = open_another()
    with plug_to(front_server) as head, plug_to(front_server) as body, plug_to(front_server) as lab:
        head.sendall(b"GET / HTTP/1.1\r\nHost: 127.0")
        body.sendall(
            b"POST /runs/import HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 100000\r\n"
            b"Content-Type: multipart/form-data; boundary=x\r\n\r\n--x\r\n"
        )
        lines = "".join(f"{name.replace('_', '-')}: {value}\r\n" for name, value in upgrade().items())
        lab.sendall(f"GET /lab HTTP/1.1\r\nHost: 127.0.0.1:{front_server.port}\r\n{lines}\r\n".encode())
        wait_until(lambda: is_closed(head), "the slow head ends")
        wait_until(lambda: is_closed(body), "the slow body ends")
        time.sleep(2 * connections.LOOK)
        assert not is_closed(lab), "whoever looks at the lab stays"


def test_a_visitor_who_leaves_before_the_answer_causes_no_error(
    front_server: FrontServer, recorded: Path, caplog: pytest.LogCaptureFixture
):
    def on_their_way() -> list[Path]:
        return list(front_server.temporary_folder.glob("file-*"))

    form = f"run={recorded.stem}&format=rrd".encode()
    head = f"POST /runs/export HTTP/1.1\r\nHost: 127.0.0.1:{front_server.port}\r\nContent-Type: {FORM}\r\n"
    with plug_to(front_server) as plug:
        plug.sendall(f"{head}Content-Length: {len(form)}\r\n\r\n".encode() + form)
        wait_until(on_their_way, "the archive is being made")
        plug.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    wait_until(lambda: not on_their_way(), "nothing of it is left")
    assert ask(front_server.url).status == 200
    assert not [record for record in caplog.records if record.exc_info]


def test_a_visitor_who_leaves_the_lab_is_not_logged_as_refused(
    front_server: FrontServer, caplog: pytest.LogCaptureFixture
):
    lines = "".join(f"{name.replace('_', '-')}: {value}\r\n" for name, value in upgrade().items())
    head = f"GET /lab HTTP/1.1\r\nHost: 127.0.0.1:{front_server.port}\r\n{lines}\r\n".encode()
    (place,) = front_server.places.running()
    for linger in (0, 1) * 10:
        with plug_to(front_server) as plug:
            plug.sendall(head)
            assert plug.recv(1000).startswith(b"HTTP/1.1 101")
            plug.recv(10_000)
            plug.sendall(b"\x89\x80\0\0\0\0" * 200)  # Pings, which the server answers.
            plug.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", linger, 0))
    wait_until(lambda: place.visitors == 0, "all have left")
    assert not [record for record in caplog.records if "Refused" in record.getMessage()]


def test_guesses_are_slowed_and_the_right_token_passes(open_another: Callable[..., FrontServer]):
    front_server = open_another(token=TOKEN)
    began = time.monotonic()
    for number in range(int(FREE) + 6):
        assert ask(front_server.url, f"/?token=guess-{number}").status == 401
    assert time.monotonic() - began > 2.0, "after the free ones each takes half a second"
    assert ask(front_server.url, f"/?token={TOKEN}").status == 303


def test_a_foreign_link_asks_before_it_ends_the_run(front_server: FrontServer):
    foreign = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Dest": "document", "Sec_Fetch_Mode": "navigate"}
    (place,) = front_server.places.running()
    name = place.status().name
    for headers in (foreign, foreign | {"Sec_Fetch_Site": "same-site"}):
        answer = ask(front_server.url, "/lab/stiff-beam", **headers)
        assert (answer.status, "Open this scenario?" in answer.text) == (200, True)
        assert 'href="/lab/stiff-beam"' in answer.text
    assert place.status().name == name
    own = ask(front_server.url, "/lab/paper", Sec_Fetch_Site="same-origin", Sec_Fetch_User="?1")
    assert own.status == 303
    assert ask(front_server.url, "/lab/", **foreign).status == 200, "looking alone asks nothing"


def test_a_malformed_request_is_answered_400_with_a_sentence(front_server: FrontServer, recorded: Path):
    notes = f"/runs/{recorded.stem}/notes"
    ask(front_server.url, notes, "POST", b"note=kept&tags=kept&keep=1", Content_Type=FORM)
    ask(front_server.url, notes, "POST", b"", Content_Type=FORM)
    bad: list[Answer] = [
        ask(front_server.url, "/?x=%0d%0a"),
        ask(front_server.url, "/lab?x=%0d%0aSet-Cookie:a=b"),
        ask(front_server.url, notes, "POST", b"note=x", Content_Type=f"{FORM}; charset=klingon"),
        ask(front_server.url, notes, "POST", b"note=x", Content_Type=f"{FORM}; charset=utf-16"),
        ask(front_server.url, notes, "POST", b"\x1f\x8b\x08", Content_Type=FORM, Content_Encoding="gzip"),
        ask(front_server.url, notes, "POST", b"note=\xff\xfe", Content_Type=FORM),
        *(
            ask(front_server.url, notes, "POST", b'{"note": "x"}', Content_Type=f"{kind}/{kind}")
            for kind in ("a", "multipart")
        ),
        *(ask(front_server.url, "/", Host=host) for host in ("[::::]", "[1]", "[", "[:]:80", "a b")),
    ]
    for answer in bad:
        assert (answer.status, "failed" in answer.text) == (400, False), answer.text
    twice = [
        ask(front_server.url, notes, "POST", b"note=x&shown-note=kept&note=y", Content_Type=FORM),
        ask(front_server.url, "/studies", "POST", b"duration=3&duration=4", Content_Type=FORM),
        ask(front_server.url, f"/runs/{recorded.stem}/export?format=csv&start=0.1&end=0.3&start=0.2"),
    ]
    for answer, name in zip(twice, ("note", "duration", "start"), strict=True):
        assert (answer.status, f"{name} is given twice: give it one value." in answer.text) == (400, True), answer.text
    row = find_row(front_server.settings.logs, recorded.stem)
    assert (row.note, row.tags, row.kept) == ("kept", ("kept",), True)
    annotate_run(row, "", "", kept=False)
    file = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a\x00b.csv"\r\n\r\n1\r\n--x--\r\n'
    answer = ask(front_server.url, "/runs/import", "POST", file, Content_Type="multipart/form-data; boundary=x")
    assert answer.status in (400, 422), answer.text


def test_control_characters_in_a_note_are_made_visible(front_server: FrontServer, recorded: Path):
    row = find_row(front_server.settings.logs, recorded.stem)
    annotate_run(row, "\x1b[2J\x1b]0;owned\x07 plain\nsecond", "tag\x9b31m", False)
    again = find_row(front_server.settings.logs, recorded.stem)
    assert again.note == "␛[2J␛]0;owned␇ plain\nsecond"
    assert again.tags == ("tag\N{REPLACEMENT CHARACTER}31m",)
    annotate_run(row, "", "", False)
    assert visible("Größe\t±1") == "Größe\t±1"


def test_one_address_cannot_take_all_private_labs(open_another: Callable[..., FrontServer]):
    front_server = open_another(private=True, max_sessions=2)
    first, second = Person(front_server, ""), Person(front_server, "")
    assert "0 of 2 labs in use. You get one of your own." in first.ask("/").text
    first.enter()
    assert "1 of 2 labs in use. Your address has as many as it may have." in second.ask("/").text
    full = second.ask("/lab/")
    assert (full.status, "1 of 1 labs that one address may have" in full.text) == (503, True)


def test_a_hanging_lab_is_replaced_its_visitor_told_and_its_run_kept(
    open_another: Callable[..., FrontServer], monkeypatch: pytest.MonkeyPatch
):
    front_server = open_another(private=True, max_sessions=4)
    anna, ben = Person(front_server, ""), Person(front_server, "")
    path, bens = anna.enter(), ben.enter()
    place = anna.place
    run = wait_until(lambda: place.status().recording, "it is recorded")

    def samples() -> int:
        with contextlib.suppress(RecordingError):
            return len(read_recording(run).samples)
        return 0

    wait_until(samples, "something of it is in its file")
    with monkeypatch.context() as soon:
        soon.setattr(per_visitor, "SILENCE", 4.0)
        soon.setattr(per_visitor, "LAST_CHANCE", 0.5)
        os.kill(place.process.pid, signal.SIGSTOP)
        told = wait_until(lambda: '"open": false' in anna.state(path) and anna.state(path), "its visitor is told")
        wait_until(lambda: place.process.exitcode is not None, "the hanging process is gone")
    sentence = json.loads(told)["sentence"]
    assert "stopped answering" in sentence
    assert "your run was kept" in sentence
    assert anna.enter("/lab/gravity") != path
    wait_until(lambda: run_state(run) == "recovered", "Anna's run is made whole")
    assert samples() > 0
    assert ben.enter() == bens, "Ben's lab runs on"


def test_temporary_folders_of_killed_servers_are_removed():
    left = Path(tempfile.gettempdir()) / "flexlab-server-99999999-abc"
    left.mkdir()
    os.utime(left, (0, 0))
    odd = left.with_name("flexlab-server-99999999-odd")
    odd.mkdir()
    os.mkfifo(odd / LOCK)  # Another user's pipe, which would hold up the start.
    with temporary_folder() as own:
        assert not left.exists()
        remove_left()
        assert own.exists(), "a server that runs keeps its folder"
    assert not own.exists()
    assert odd.exists()
    shutil.rmtree(odd)


def test_own_presets_are_limited_in_number_and_their_pictures_follow(
    front_server: FrontServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    scenario = load_preset("soft-beam")
    for number in range(MOST_PRESETS):
        save_preset(scenario, f"own-{number}")
    with pytest.raises(PresetError, match="already"):
        save_preset(scenario, "one-more")
    save_preset(scenario, "own-1")
    first = ask(front_server.url).text
    assert "own-3" in first
    drawn = wait_until(
        lambda: (text := ask(front_server.url).text).count("<polyline") > MOST_PRESETS and text, "pictures"
    )
    assert drawn.count('class="beam"') >= MOST_PRESETS


def test_a_lab_goes_on_after_mutated_messages_of_every_kind(
    open_another: Callable[..., FrontServer], caplog: pytest.LogCaptureFixture
):
    front_server = open_another()
    with ThreadPoolExecutor(1) as thread:
        address = f"ws://127.0.0.1:{front_server.port}/lab"
        thread.submit(Attack(address, messages=800, seed=7).run).result()
    (place,) = front_server.places.running()
    assert ask(front_server.url, "/lab/stiff-beam").status == 303
    wait_until(lambda: place.status().name == "stiff-beam", "a fresh visitor gets what they ask for")
    a_fresh_visitor_sees_a_moving_lab(front_server)
    assert not [record for record in caplog.records if record.exc_info and record.name != "websockets.client"]
    assert sum(len(record.getMessage()) for record in caplog.records if record.levelno >= logging.WARNING) < 50_000
