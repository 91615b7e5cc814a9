"""What the lab relies on although viser does not promise it. A failure here says what to look at after an update."""

import asyncio
import re
import threading
import types
import typing
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import pytest
import viser
from lab_page import wait_until
from raw_browser import CAMERA, RawBrowser, widget
from viser import _messages
from viser.infra._messages import get_type_hints_cached, wire_field_names

import flexlab.lab
from flexlab.lab import browser_messages
from flexlab.lab.session import Session
from flexlab.lab.viser_internals import VERSION, client_of, find_input, is_command, scene_instances

MESSAGES = typing.get_args(browser_messages.Heard)


def plain(kind: typing.Any) -> str:
    """The name of a declared type without our limits, in one spelling."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return plain(arguments[0])
    if origin in (typing.Union, types.UnionType):
        return " | ".join(sorted(map(plain, arguments)))
    if origin is typing.Literal:
        return " | ".join(sorted({type(item).__name__ for item in arguments}))
    if origin is not None:
        return f"{origin.__name__}[{', '.join(map(plain, arguments))}]"
    return getattr(kind, "__name__", str(kind))


def fields_of_viser(name: str) -> dict[str, typing.Any]:
    """Declared type of each field of a message from viser's page; empty if viser has no such message."""
    message = getattr(_messages, name, None)
    if message is None:
        return {}
    hints = get_type_hints_cached(message)
    return {field: hints[field] for field in wire_field_names(message)}


def test_viser_is_the_version_whose_internals_are_known() -> None:
    assert viser.__version__.startswith(f"{VERSION}."), (
        f"viser is {viser.__version__}, but lab/viser_internals.py knows {VERSION}: read viser's infra/_infra.py, _gui_api.py "
        "and _scene_api.py again, make this file pass, then raise VERSION and the limit in pyproject.toml."
    )


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.__name__)
def test_a_message_has_the_fields_that_we_check(message: type[msgspec.Struct]) -> None:
    theirs = {name: plain(kind) for name, kind in fields_of_viser(message.__name__).items()}
    ours = {name: plain(kind) for name, kind in typing.get_type_hints(message, include_extras=True).items()}
    if message.__name__ == "FileTransferPart":
        theirs["source_component_uuid"] = "str"  # None occurs only in messages to the browser.
    assert theirs == ours, (
        f"viser's {message.__name__} has changed: bring lab/browser_messages.py in line, and look whether its "
        "handlers now do more with it."
    )


def test_only_one_file_uses_private_names_of_viser() -> None:
    folder = Path(flexlab.lab.__file__).parent
    private = re.compile(r"viser\._|from viser import _|\._impl\b|_websock|_handle_from|_queue_update|viser\.infra")
    guilty = [
        f"{file.relative_to(folder)}:{number}"
        for file in folder.rglob("*.py")
        if file.name != "viser_internals.py"
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1)
        if private.search(line)
    ]
    assert not guilty, f"move this into lab/viser_internals.py: {', '.join(guilty)}"


def test_every_message_passes_the_guard_before_viser_reads_it(session: Session) -> None:
    with RawBrowser(session) as browser:
        wait_until(session.server.get_clients, "the browser is a client", 20)
        before = session.guard.refused
        browser.send({"type": "ShareUrlRequest"})
        wait_until(
            lambda: session.guard.refused == before + 1,
            "viser no longer reads messages by the connection's recv(): the guard is not asked (viser_internals)",
            20,
        )


def test_clients_widgets_commands_and_nodes_are_found(session: Session) -> None:
    with RawBrowser(session) as browser:
        server = session.server
        wait_until(server.get_clients, "the browser is a client", 20)
        (connection,) = server._websock_server._live_connections.values()
        (client,) = server.get_clients()
        assert client_of(server, connection) == client, "viser keeps its connections otherwise (client_of)"
        uuid = widget(session, "Reset")._impl.uuid
        assert find_input(server, client, uuid) is not None, "viser keeps its widgets otherwise (find_input)"
        command = next(iter(server.gui._command_handle_from_uuid))
        assert is_command(server, client, command), "viser keeps its commands otherwise (is_command)"
        assert scene_instances(server, "/grab") == 0, "viser keeps its scene otherwise (scene_instances)"
        assert scene_instances(server, "/nothing") is None
        assert any((scene_instances(server, name) or 0) > 1 for name in server.scene._handle_from_node_name), (
            "viser names the places of batched meshes otherwise (scene_instances)"
        )
        browser.send(CAMERA)


def test_a_click_is_not_lost_to_a_picture_that_is_drawn_meanwhile(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After viser has stored a value and before we read it, the drawing thread must not write the old one back."""
    drawn, panel = threading.Event(), session._panel
    update = panel.update

    def seen(*arguments: typing.Any) -> None:
        update(*arguments)
        drawn.set()

    async def dawdle(_: typing.Any) -> None:
        for _ in range(2):
            drawn.clear()
            drawn.wait(0.3)

    monkeypatch.setattr(panel, "update", seen)
    for label, value, taken in (
        ("Trail of the payload", True, lambda: session.lab_state.view.trail),
        ("Bending stiffness EI (N·m²)", 321.0, lambda: session.lab_state.intended.payload.bending_stiffness == 321.0),
        ("Speed", "1/16 ×", lambda: session.runner.snapshot.target_speed == 1 / 16),
    ):
        handle = widget(session, label)
        handle._impl.update_cb.insert(0, dawdle)
        with RawBrowser(session) as browser:
            browser.update(handle, {"value": value})
            wait_until(taken, f"{label} is taken", 20)


def test_a_sending_thread_leaves_it_to_the_event_loop_to_wake_its_tasks(shared_session: Session) -> None:
    """It used to walk the list of waiting tasks while the loop changed it ("deque mutated ..."): a picture was lost."""
    news = type(shared_session.server._websock_server._broadcast_buffer.message_event)()

    async def woken_by() -> list[str]:
        woken: list[str] = []

        async def wait() -> None:
            await news.wait()
            woken.append(where)

        waiting = [asyncio.create_task(wait()) for _ in range(3)]
        await asyncio.sleep(0)
        where = "the thread"
        sender = threading.Thread(target=news.set)
        sender.start()
        sender.join()
        assert news.is_set()
        await asyncio.sleep(0.01)
        where = "the loop"
        asyncio.get_running_loop().call_soon(news.set)
        await asyncio.wait_for(asyncio.gather(*waiting), 5)
        return woken

    # In a thread of its own: where a browser is driven, this one already runs a loop.
    with ThreadPoolExecutor(1) as thread:
        assert thread.submit(asyncio.run, woken_by()).result() == ["the loop"] * 3


def test_a_message_to_a_browser_that_has_left_is_dropped_without_a_warning(
    session: Session, recwarn: pytest.WarningsRecorder
) -> None:
    with RawBrowser(session) as browser:
        browser.receive(20)
        (client,) = wait_until(lambda: list(session.server.get_clients().values()), "it is a client", 20)
        wait_until(lambda: client.camera.position is not None, "its camera is known", 20)
    wait_until(lambda: not session.server.get_clients(), "it has left", 20)
    client.camera.position = (1.0, 2.0, 3.0)
    assert [str(each.message) for each in recwarn if "closed connection" in str(each.message)] == []
