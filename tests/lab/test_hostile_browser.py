"""A hostile browser: the lab goes on for everybody else, keeps nothing that it sends, and the log stays short."""

import asyncio
import http.client
import logging
import math
import socket
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from lab_page import wait_until
from raw_browser import CAMERA, RawBrowser, widget
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from flexlab.lab import picking
from flexlab.lab.session import Session
from flexlab.lab.viser_internals import bound_transport
from flexlab.lab.viser_server import LARGEST_UPLOAD
from flexlab.presets import load_preset
from flexlab.sim.commands import Play, Pull

NESTED: Any = []
for _ in range(600):
    NESTED = [NESTED]


@pytest.fixture
def session(lasting_session: Session) -> Session:
    """One lab for all tests of this file."""
    return lasting_session


def upload_button(session: Session) -> str:
    return widget(session, "Open a file")._impl.uuid


def start(session: Session, transfer: Any, **changes: Any) -> dict[str, Any]:
    return {
        "type": "FileTransferStartUpload",
        "source_component_uuid": upload_button(session),
        "transfer_uuid": transfer,
        "filename": "x.json",
        "mime_type": "application/json",
        "part_count": 2,
        "size_bytes": 10,
        **changes,
    }


def part(session: Session, transfer: Any, **changes: Any) -> dict[str, Any]:
    return {
        "type": "FileTransferPart",
        "source_component_uuid": upload_button(session),
        "transfer_uuid": transfer,
        "part_index": 0,
        "content": b"12345",
        **changes,
    }


def a_fresh_visitor_sees_a_moving_lab(session: Session) -> None:
    """Check that a new browser gets the page, and that simulated time goes on."""
    with RawBrowser(session) as browser:
        assert len(browser.receive(20)) > 1000
        before = float(session.runner.snapshot.latest.time[0])
        wait_until(lambda: float(session.runner.snapshot.latest.time[0]) > before + 0.1, "time goes on", 20)
        counter = session.server._websock_server._broadcast_buffer.message_counter
        wait_until(
            lambda: session.server._websock_server._broadcast_buffer.message_counter > counter + 10, "it is drawn", 20
        )


def test_a_file_part_that_could_not_be_acknowledged_is_refused(session: Session) -> None:
    with RawBrowser(session) as browser:
        browser.send(start(session, "t"))
        browser.send(part(session, "t", source_component_uuid=NESTED))
        wait_until(lambda: session.guard.refused == 2, "start and part are refused", 20)
        browser.send(start(session, "t", part_count=2, size_bytes=150_000))
        browser.send(part(session, "t", source_component_uuid=NESTED))
        wait_until(lambda: session.guard.refused == 3, "the part is refused", 20)
        a_fresh_visitor_sees_a_moving_lab(session)
        browser.receive(20)


@pytest.mark.parametrize(
    "changes",
    [
        {"image_height": 0},
        {"image_width": -1},
        {"image_height": "high"},
        {"position": [1.0, 2.0]},
        {"position": [math.nan, 0.0, 1.0]},
        {"look_at": [0.0, 0.0, 5.0]},
        {"up_direction": [0.0, 0.0, 0.0]},
        {"up_direction": [math.nan, 0.0, 1.0]},
        {"wxyz": [0.0, 0.0, 0.0, 0.0]},
        {"fov": 0.0},
        {"fov": math.inf},
        {"near": -1.0},
        {"more": 1},
    ],
    ids=str,
)
def test_an_impossible_camera_is_refused(session: Session, changes: dict[str, Any]) -> None:
    with RawBrowser(session) as browser:
        clients = wait_until(session.server.get_clients, "it is a client", 20)
        (client,) = clients.values()
        # The lab may still be placing the new camera: its position proves nothing, the size of the picture does.
        truth = client.camera.image_height
        browser.send(CAMERA | {"image_height": truth + 1} | changes)
        wait_until(lambda: session.guard.refused == 1, "it is refused", 20)
        assert client.camera.image_height == truth
        assert np.isfinite(client.camera.position).all()


@pytest.mark.parametrize("protocols", [None, ["viser-v0.1"], ["chat"], ["viser-v" + "9" * 200]], ids=str)
def test_a_page_of_another_version_is_closed_without_output_in_the_terminal(
    session: Session, protocols: Any, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    with connect(session.url.replace("http", "ws"), subprotocols=protocols, close_timeout=1) as plug:
        with pytest.raises(ConnectionClosed) as ended:
            plug.recv(timeout=20)
        assert ended.value.rcvd is not None
        assert ended.value.rcvd.code == 1002, "viser's page then says so"
    a_fresh_visitor_sees_a_moving_lab(session)
    assert capfd.readouterr() == ("", "")
    assert not [record for record in caplog.records if record.exc_info]


def test_a_camera_that_fails_affects_only_its_own_browser(session: Session, caplog: pytest.LogCaptureFixture) -> None:
    with RawBrowser(session) as bad, RawBrowser(session):
        wait_until(lambda: len(session.server.get_clients()) == 2, "both are clients", 20)
        bad.update(widget(session, "Follow"), {"value": True})
        client = min(session.server.get_clients().values(), key=lambda client: client.client_id)
        # As if viser itself had let it through.
        client.camera._state.up_direction = np.zeros(3)
        time.sleep(1.0)
        a_fresh_visitor_sees_a_moving_lab(session)
    assert not [record for record in caplog.records if record.getMessage().startswith("Drawing failed")]


def test_parts_of_a_file_beyond_what_was_announced_are_refused(session: Session) -> None:
    with RawBrowser(session) as browser:
        browser.send(start(session, "many", part_count=20, size_bytes=100))
        browser.send(start(session, "t", part_count=2, size_bytes=150_000))
        wait_until(lambda: session.guard.refused == 1, "twenty parts for 100 bytes are refused", 20)
        for index in range(20):
            browser.send(part(session, "t", part_index=index % 2, content=bytes(1_000_000)))
        wait_until(lambda: session.guard.refused == 21, "every part is refused", 60)
        kept = session.server.gui._current_file_upload_states.values()
        assert [state["transferred_bytes"] for state in kept] == [0]
    wait_until(lambda: not session.server.gui._current_file_upload_states, "nothing of it is kept", 20)


def test_a_file_shorter_than_announced_is_refused_in_a_sentence(
    session: Session, capfd: pytest.CaptureFixture[str]
) -> None:
    with RawBrowser(session) as browser:
        browser.send(start(session, "none", part_count=0, size_bytes=5))
        wait_until(lambda: session.guard.refused == 1, "bytes without a part are refused", 20)
        browser.send(start(session, "t", part_count=1))
        browser.send(part(session, "t", content=b"123"))
        wait_until(lambda: "did not arrive completely" in session.lab_state.notice.text, "it is told", 20)
        assert session.guard.refused == 2
    wait_until(lambda: not session.server.gui._current_file_upload_states, "nothing of it is kept", 20)
    assert capfd.readouterr() == ("", ""), "viser itself would write a line for each"


@pytest.mark.parametrize("label", ["Bending stiffness EI, slider", "Plot window"])
def test_a_file_for_anything_but_the_button_is_refused(session: Session, label: str) -> None:
    handle = widget(session, label)
    before = handle.value
    with RawBrowser(session) as browser:
        browser.send(start(session, "t", source_component_uuid=handle._impl.uuid, part_count=0, size_bytes=0))
        wait_until(lambda: session.guard.refused == 1, "it is refused", 20)
    assert handle.value == before


def test_a_huge_upload_is_refused_before_it_is_kept(session: Session) -> None:
    with RawBrowser(session) as browser:
        browser.send(start(session, "t", size_bytes=LARGEST_UPLOAD + 1))
        wait_until(lambda: "not a scenario file" in session.lab_state.notice.text, "the upload is refused", 20)
        assert not session.server.gui._current_file_upload_states


def test_form_messages_are_not_kept_for_later_browsers(session: Session) -> None:
    buffer = session.server._websock_server._broadcast_buffer
    with RawBrowser(session) as browser:
        for number in range(60):
            browser.send({"type": "GuiFormDirtyMessage", "uuid": f"{number}" + "x" * 100_000})
        wait_until(lambda: session.guard.refused == 60, "all are refused", 60)
    kept = [message for message in buffer.message_from_id.values() if type(message).__name__ == "GuiFormDirtyMessage"]
    assert kept == []


def test_only_the_browser_that_sends_a_file_hears_of_it(session: Session) -> None:
    to_all = session.server._websock_server._broadcast_buffer.message_from_id
    with RawBrowser(session) as browser:
        for number in range(8):  # The button takes one file after the other.
            browser.send(start(session, f"t{number}", part_count=1))
            browser.send(part(session, f"t{number}", content=bytes(10)))
            wait_until(lambda word=f"t{number}": browser.hears_of(word), "it is acknowledged", 20)
        browser.send(start(session, "large", size_bytes=LARGEST_UPLOAD + 1))
        wait_until(lambda: browser.hears_of("large"), "the button waits no longer for what is not taken", 20)
    assert not [message for message in to_all.values() if type(message).__name__ == "FileTransferPartAck"]


UNHASHABLE: dict[str, Callable[[Session], dict[str, Any]]] = {
    "update": lambda _: {"type": "GuiUpdateMessage", "uuid": [], "updates": {"value": 1}},
    "updates": lambda _: {"type": "GuiUpdateMessage", "uuid": "x", "updates": [1]},
    "deep": lambda _: {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": NESTED}},
    "command": lambda _: {"type": "CommandTriggerMessage", "uuid": {}},
    "hold": lambda _: {"type": "GuiButtonHoldMessage", "uuid": [[]], "frequency": 1.0},
    "hold NaN": lambda session: {
        "type": "GuiButtonHoldMessage",
        "uuid": widget(session, "Step")._impl.uuid,
        "frequency": math.nan,
    },
    "upload": lambda session: start(session, []),
    "press of the upload's button": lambda session: {
        "type": "GuiUpdateMessage",
        "uuid": upload_button(session),
        "updates": {"value": True},
    },
    "upload of bytes": lambda session: start(session, "t", size_bytes=-1),
    "click": lambda _: {"type": "SceneNodeClickMessage", "name": [], "instance_index": None},
    "type": lambda _: {"type": []},
    "no type": lambda _: {},
    "unknown type": lambda _: {"type": "NoSuchMessage"},
    "share": lambda _: {"type": "ShareUrlRequest"},
    "render": lambda _: {"type": "GetRenderResponseMessage", "payload": b"x" * 1000, "render_uuid": "x"},
    "to the browser": lambda _: {"type": "RunJavascriptMessage", "source": "alert(1)"},
}


@pytest.mark.parametrize("kind", UNHASHABLE)
def test_messages_that_no_page_sends_are_counted_and_logged_once(
    session: Session, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    message = UNHASHABLE[kind](session)
    with RawBrowser(session) as browser:
        wait_until(session.server.get_clients, "it is a client", 20)
        for _ in range(20):
            browser.send(message)
        wait_until(lambda: session.guard.refused == 20, "all are refused", 20)
        assert session.server.get_clients(), "it is still connected"
    assert len([record for record in caplog.records if "Refused a message" in record.getMessage()]) <= 1
    assert not [record for record in caplog.records if record.exc_info]


DRAG = {
    "type": "SceneNodeDragMessage",
    "phase": "start",
    "name": "/grab",
    "instance_index": None,
    "start_position": [0.0, 0.5, 0.0],
    "start_screen_pos": [0.5, 0.5],
    "end_position": [0.0, 0.5, 0.0],
    "end_screen_pos": [0.5, 0.5],
    "button": "left",
    "modifier": None,
    "owner": "",
}


def pull(session: Session) -> Pull | None:
    """The pull in the engine; None while there is none."""
    commands = [event.command for event in session.runner.snapshot.events]
    newest = next((command for command in reversed(commands) if isinstance(command, Pull)), None)
    return newest if newest is not None and newest.stiffness > 0 else None


def test_only_a_valid_drag_of_something_in_the_scene_pulls_until_its_browser_leaves(session: Session) -> None:
    bad = ({"name": "/none"}, {"end_position": [math.inf, 0, 0]}, {"owner": "1"}, {"modifier": "fn"}, {"phase": "x"})
    with RawBrowser(session) as browser:
        for changes in bad:
            browser.send(DRAG | changes)
        wait_until(lambda: session.guard.refused == len(bad), "all are refused", 20)
        browser.send(DRAG)
        wait_until(lambda: pull(session), "a proper one pulls", 20)
    wait_until(lambda: pull(session) is None, "the hand of one who has left lets go", 20)
    assert session.lab_state.pulled is None


def test_a_pull_ends_when_its_browser_falls_silent_and_only_then(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(picking, "LONGEST_SILENCE", 2.0)
    with RawBrowser(session) as browser, RawBrowser(session) as other:
        wait_until(lambda: len(session.server.get_clients()) == 2, "both are clients", 20)
        browser.send(DRAG)
        wait_until(lambda: pull(session), "somebody pulls", 20)
        for _ in range(30):  # A mouse that is held still.
            time.sleep(0.1)
            browser.send(CAMERA)
            other.send(DRAG | {"phase": "end"})
        assert pull(session), "the pull of another is not ended, and a sign of life suffices"
        other.send(DRAG | {"end_position": [0.0, 0.8, 0.0]})
        wait_until(lambda: (now := pull(session)) and now.target[1] > 0.6, "who begins to drag takes over", 20)
        wait_until(lambda: pull(session) is None, "a silent one lets go", 20)


def test_limiting_the_buffer_of_a_connection_that_has_ended_raises_nothing() -> None:
    async def end() -> None:
        transport, _ = await asyncio.get_running_loop().connect_accepted_socket(asyncio.Protocol, here)
        transport.abort()
        await asyncio.sleep(0.01)
        bound_transport(transport)

    here, there = socket.socketpair()
    with there, here, ThreadPoolExecutor(1) as apart:  # A browser of other tests may hold this thread's loop.
        apart.submit(asyncio.run, end()).result()


def test_a_flood_of_presses_is_slowed_down_and_other_browsers_are_served(session: Session) -> None:
    with RawBrowser(session) as browser, RawBrowser(session) as watcher:
        wait_until(lambda: len(session.server.get_clients()) == 2, "both are clients", 20)
        reset = widget(session, "Reset")
        run = session.runner.snapshot.run_number
        for _ in range(300):
            browser.update(reset, {"value": True})
        before = time.monotonic()
        time.sleep(3.0)
        runs = session.runner.snapshot.run_number - run
        assert runs <= 30 + 12 * (time.monotonic() - before), "30 at once, then ten a second"
        assert watcher.receive(20)


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Host": "evil.example"},
        {"Origin": "null"},
        {"Host": "[::::]"},
        {"Origin": "http://[1]"},
    ],
    ids=str,
)
def test_a_lab_on_its_own_refuses_foreign_hosts_and_origins(session: Session, headers: dict[str, str]) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", session.port, timeout=30)
    connection.request("GET", "/", headers=headers)
    assert connection.getresponse().status == 403
    connection.close()


def test_a_run_that_could_not_start_is_drawn(caplog: pytest.LogCaptureFixture) -> None:
    """It has no samples, like any run in the instant in which it begins; many presets in a row hit that instant."""
    far = load_preset("paper").replace({"trajectory.center": (0.0, 9.0, 0.0)})
    with Session(far, "far", shadows=False) as session, RawBrowser(session) as browser:
        assert session.runner.snapshot.status.failed
        assert browser.receive(20)
        time.sleep(1.0)
        session.lab_state.load(load_preset("paper"), "paper")
        session.lab_state.submit(Play())
        a_fresh_visitor_sees_a_moving_lab(session)
    assert not [record for record in caplog.records if record.exc_info]
