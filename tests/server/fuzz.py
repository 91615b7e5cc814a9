"""Send a lab mutated messages of every kind from several visitors at once, while another visitor watches.

`python tests/server/fuzz.py [MESSAGES [SEED]]` starts a lab, sends it 20 000 messages by default from another process, and prints
how far the watcher's simulation time fell behind, how much the lab's memory grew, and how long its log became.
"""

import logging
import os
import random
import re
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec.msgpack
import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # pytest adds this folder itself; a script must do so.
from raw_browser import CAMERA, open_socket, text_of

VISITORS = 4
WARM_UP = 60.0
"""Time, s, in which a lab that nobody attacks reaches its full memory."""
READ_RATE, PATIENCE = 75.0, 3.0
"""Messages per second that the lab surely reads from one visitor, button presses included; extra time to wait, s."""
TRIPLE = [0.0, 0.5, 0.0]
TOUCH = {"name": "/grab", "instance_index": None, "modifier": None, "owner": ""}
KINDS: tuple[dict[str, Any], ...] = (
    CAMERA,
    {"type": "GuiUpdateMessage", "uuid": "?", "updates": {"value": 1.0}},
    {"type": "GuiButtonHoldMessage", "uuid": "?", "frequency": 10.0},
    {"type": "CommandTriggerMessage", "uuid": "?"},
    {
        "type": "FileTransferStartUpload",
        "source_component_uuid": "?",
        "transfer_uuid": "t",
        "filename": "x.json",
        "mime_type": "application/json",
        "part_count": 1,
        "size_bytes": 100,
    },
    {"type": "FileTransferPart", "source_component_uuid": "?", "transfer_uuid": "t", "part_index": 0, "content": b"{}"},
    {"type": "SceneNodeClickMessage", **TOUCH, "ray_origin": TRIPLE, "ray_direction": [0, 0, -1], "screen_pos": [0, 0]},
    {
        "type": "SceneNodeDragMessage",
        **TOUCH,
        "phase": "update",
        "start_position": TRIPLE,
        "start_screen_pos": [0.5, 0.5],
        "end_position": TRIPLE,
        "end_screen_pos": [0.5, 0.5],
        "button": "left",
    },
    {"type": "GuiFormDirtyMessage", "uuid": "?"},
    {"type": "GuiFormSubmitMessage", "uuid": "?"},
    {"type": "ShareUrlRequest"},
    {
        "type": "ScenePointerMessage",
        "event_type": "click",
        "ray_origin": TRIPLE,
        "ray_direction": TRIPLE,
        "screen_pos": [],
    },
    {"type": "GetRenderResponseMessage", "payload": b"x" * 500, "render_uuid": "?"},
    {"type": "RunJavascriptMessage", "source": "alert(1)"},
    {"type": "LocalStorageGetItemResponseMessage", "value": "x", "error": None, "request_uuid": "?"},
    {"type": "TransformControlsUpdateMessage", "name": "/grab", "wxyz": [1, 0, 0, 0], "position": TRIPLE, "owner": ""},
)
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1e308, -1e-308, float("nan"), float("inf"), 2**63, "", "x" * 300, "\x00", "é", "\x1b[2J", b"\xff",
    [], {}, [[[[]]]], [float("nan")] * 3, [1e12] * 3, {"value": {}}, {"gui_api": 1}, "stiff-beam", "1/4 ×", "start", "end",
)  # fmt: skip


def mutated(random_of: random.Random, uuids: list[str]) -> bytes:
    """Return one message: proper, or with fields changed, removed, added or deeply nested; rarely one bit is flipped."""
    message = dict(random_of.choice(KINDS))
    for name, value in message.items():
        if value == "?" and uuids:
            message[name] = random_of.choice(uuids)
    for _ in range(random_of.choice((0, 1, 1, 1, 2, 3))):
        name, what = random_of.choice(list(message)), random_of.random()
        if what < 0.7:
            message[name] = random_of.choice(VALUES)
        elif what < 0.8 and name != "type":
            message.pop(name)
        elif what < 0.9:
            message[f"more-{random_of.randrange(5)}"] = random_of.choice(VALUES)
        else:
            nested: Any = 1
            for _ in range(random_of.choice((3, 60, 600))):
                nested = [nested]
            message[name] = nested
        if not message:
            break
    data = bytearray(msgspec.msgpack.encode(message))
    if random_of.random() < 0.001:
        data[random_of.randrange(len(data))] ^= 1 << random_of.randrange(8)
    return bytes(data)


@dataclass
class Attack:
    """Visitors who send mutated messages; each reads what the lab sends, as a browser would."""

    address: str
    messages: int
    seed: int
    sent: int = 0
    problems: list[str] = field(default_factory=list)

    def run(self) -> None:
        """Send all messages."""
        threads = [threading.Thread(target=self._visit, args=(number,)) for number in range(VISITORS)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    def _visit(self, number: int) -> None:
        random_of = random.Random(self.seed * VISITORS + number)
        left = self.messages // VISITORS
        uuids: list[str] = []
        while left:
            try:
                with open_socket(self.address) as plug:
                    if not uuids:
                        uuids += sorted(set(re.findall(r"[0-9a-f]{8}-[0-9a-f-]{27}", text_of(plug.recv(20)))))[:300]
                    began, before = time.monotonic(), left
                    reader = threading.Thread(target=_read, args=(plug,), daemon=True)
                    reader.start()
                    while left:
                        plug.send(mutated(random_of, uuids))
                        left -= 1
                        self.sent += 1
                    # The lab never looks at what is still in a buffer when the connection ends.
                    time.sleep(max(began + PATIENCE + before / READ_RATE - time.monotonic(), 0.0))
            except (ConnectionClosed, TimeoutError, OSError):
                continue  # The lab closed the connection: the visitor comes back.


def _read(plug: ClientConnection) -> None:
    try:
        while True:
            plug.recv()
    except Exception:
        return


@dataclass
class Lateness:
    """Measures how far a playing run falls behind the wall clock at its chosen speed."""

    runner: Any
    worst: float = 0.0
    """The largest lag, s of simulated time."""
    _stop: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> "Lateness":
        self._thread = threading.Thread(target=self._look)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _look(self) -> None:
        began: tuple[Any, float, float] | None = None
        while not self._stop.wait(0.02):
            snapshot, now = self.runner.snapshot, time.monotonic()
            runs = snapshot.playing and not snapshot.status.failed
            key = (snapshot.run_number, snapshot.target_speed) if runs else None
            at = float(snapshot.latest.time[0])
            if key is None or began is None or began[0] != key:
                began = (key, now, at) if key is not None else None
                continue
            self.worst = max(self.worst, (now - began[1]) * snapshot.target_speed - (at - began[2]))


def main(messages: int = 20_000, seed: int = 1) -> None:
    """Do the full measurement, with the lab in this process and the visitors in another."""
    from flexlab.presets import load_preset
    from flexlab.server.front_server import open_front_server
    from flexlab.server.settings import Settings

    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    os.chdir(folder)
    logging.basicConfig(filename=folder / "log.txt", level=logging.INFO)
    lab = psutil.Process()
    with open_front_server(Settings(logs=folder / "logs", port=0), load_preset("paper"), "paper") as front_server:
        address = f"ws://127.0.0.1:{front_server.port}/lab"
        (place,) = front_server.places.running()
        runner = place._session.runner  # type: ignore[attr-defined]
        with open_socket(address) as watcher:
            threading.Thread(target=_read, args=(watcher,), daemon=True).start()
            time.sleep(WARM_UP)
            memory, began = lab.memory_info().rss, time.monotonic()
            with Lateness(runner) as lateness:
                subprocess.run([sys.executable, __file__, "attack", address, str(messages), str(seed)], check=True)
            taken = time.monotonic() - began
            time.sleep(10)
            grown = lab.memory_info().rss - memory
        guard = place._session.guard  # type: ignore[attr-defined]
        closing = time.monotonic()
    closing = time.monotonic() - closing
    print(f"{messages} messages in {taken:.0f} s, {guard.refused} refused, {runner.snapshot.run_number} runs begun")
    print(f"the watcher's simulation time fell behind by {lateness.worst:.2f} s at most; memory {grown / 1e6:+.1f} MB")
    print(f"log {(folder / 'log.txt').stat().st_size} bytes; closing took {closing:.1f} s; all in {folder}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["attack"]:
        Attack(sys.argv[2], int(sys.argv[3]), int(sys.argv[4])).run()
    else:
        main(*map(int, sys.argv[1:]))
