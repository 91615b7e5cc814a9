"""A control law computed by another program: the examples in C and Python drive the arms, and failures are reported."""

import contextlib
import os
import re
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from own_law_text import allow_no_own_laws

import flexlab
from flexlab import gain
from flexlab.analysis.leaderboard import store
from flexlab.analysis.leaderboard.store import law_source
from flexlab.errors import ScenarioError
from flexlab.own import link
from flexlab.own.files import law_kind
from flexlab.own.link import ANSWERS, ASKS, Link, address_in, text_of_program
from flexlab.own.measurement import BELIEVED, Believed, Measurement
from flexlab.own.reading import TextProblem
from flexlab.physics.law_input import make_law_input
from flexlab.presets import load_preset
from flexlab.sim.world import World

Answer = Callable[[dict[str, Any]], Any]
INPUTS = [[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]]


def packed(message: Any) -> bytes:
    data = msgspec.msgpack.encode(message)
    return len(data).to_bytes(4, "big") + data


class Program:
    """A program on a thread: it sends `greeting`, then `answer` of each message, raw if bytes, else packed."""

    def __init__(self, answer: Answer, greeting: Any = None):
        self._answer, self._greeting = answer, {"version": 1} if greeting is None else greeting
        self.asked: list[Any] = []
        self._connections: list[socket.socket] = []
        self.server = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp://127.0.0.1:{self.server.getsockname()[1]}"
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def close(self) -> None:
        for each in (self.server, *self._connections):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
        self.server.close()
        self._thread.join()

    def _listen(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self.server.accept()
                self._connections.append(connection)
                with connection, contextlib.suppress(OSError):
                    self._serve(connection)

    def _serve(self, connection: socket.socket) -> None:
        while head := connection.recv(4, socket.MSG_WAITALL):
            self.asked.append(msgspec.msgpack.decode(connection.recv(int.from_bytes(head, "big"), socket.MSG_WAITALL)))
            say = self._greeting if "protocol" in self.asked[-1] else self._answer(self.asked[-1])
            if say is None:
                return
            connection.sendall(say if isinstance(say, bytes) else packed(say))


@pytest.fixture
def program() -> Iterator[Callable[..., Program]]:
    made: list[Program] = []

    def make(answer: Answer = lambda _: {"inputs": INPUTS}, greeting: Any = None) -> Program:
        made.append(Program(answer, greeting))
        return made[-1]

    yield make
    for one in made:
        one.close()


def instant(time: float = 1.0) -> Measurement:
    now = make_law_input(2)
    now["time"] = time
    return Measurement(now[0], 1e-3, lambda: Believed(bytes(BELIEVED.itemsize)))


def problem_of(one: Program) -> str:
    with pytest.raises(TextProblem) as caught:
        Link(one.address).ask(instant(), np.zeros(16))
    return str(caught.value)


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        ({}, "its answer has neither inputs nor torques."),
        (
            {"inputs": INPUTS, "torques": INPUTS},
            "its answer has both inputs and torques, and one of them would be lost.",
        ),
        ({"inputs": [[1.0, 2.0, 3.0]]}, "the shape of its inputs is (1, 3) instead of (2, 3)."),
        ({"torques": [1.0, 2.0]}, "it sent an unreadable message (Expected `array`, got `float` - at `$.torques[0]`)."),
        ({"inputs": [[1.0], [1.0, 2.0]]}, "its inputs are lists of unequal length instead of (2, 3) numbers."),
        ({"inputs": [["a", 0, 0], [0, 0, 0]]},
         "it sent an unreadable message (Expected `float`, got `str` - at `$.inputs[0][0]`)."),
        ({"inputs": [[0, 0, 0], [0, float("nan"), 0]]}, "its inputs are not finite: [[0.0, 0.0, 0.0], [0.0, nan, 0.0]]."),
        ({"inputs": INPUTS, "memory": [1.0]}, "the shape of its memory is (1,) instead of (16,)."),
        ({"error": "too hot"}, "too hot."),
        (b"SSH-2.0-OpenSSH_9.6\r\n", "it sent a message of 1397966893 bytes, more than the 65536 allowed."),
        (b"\0\0\0\2\xc1\xc1", "it sent an unreadable message (MessagePack data is malformed"),
        (packed(7), "it sent an unreadable message (Expected `object`, got `int`)."),
        (None, "it closed the connection."),
    ],
    ids=str,
)  # fmt: skip
def test_an_invalid_answer_is_reported(program: Callable[..., Program], answer: Any, says: str):
    one = program(lambda _: answer)
    assert problem_of(one).startswith(f"{one.address}: {says}")


@pytest.mark.parametrize(
    ("greeting", "says"),
    [
        ({"version": 2}, "it speaks version 2 of the protocol, and this is version 1."),
        ({"hello": 1}, "it sent an unreadable message (Object missing required field `version`)."),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "it sent a message of 1213486160 bytes"),
    ],
    ids=str,
)
def test_an_invalid_greeting_is_reported(program: Callable[..., Program], greeting: Any, says: str):
    one = program(greeting=greeting)
    assert problem_of(one).startswith(f"{one.address}: {says}")


def test_a_silent_or_slow_program_is_given_up(program: Callable[..., Program], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(link, "GREETING_LIMIT", 0.05)
    monkeypatch.setattr(link, "ANSWER_LIMIT", 0.05)
    assert problem_of(program(greeting=b"")).endswith(": it did not greet within 0.05 s: does it serve another run?")
    assert problem_of(program(lambda _: b"\0\0")).endswith(": it did not answer within 0.05 s.")


@pytest.mark.parametrize(
    "address",
    ["tcp://localhost", "tcp://localhost:0", "tcp://a:70000", "tcp://:1", "tcp://u@a:1", 'tcp://a")\nimport os:1',
     f"tcp://{'a' * 191}:1"],
)  # fmt: skip
def test_an_invalid_address_is_refused(address: str):
    with pytest.raises(
        ScenarioError, match=r"is not an address of a program: write tcp://HOST:PORT, as in tcp://localhost"
    ):
        law_kind(address)


def test_each_message_has_the_fields_and_shapes_that_the_greeting_announces(program: Callable[..., Program]):
    one = program(lambda at: {"torques": INPUTS, "memory": [at["memory"][0] + 1] * 16})
    given, at = Link(one.address), instant()
    inputs, kept = given.ask(at, np.zeros(16))
    np.testing.assert_array_equal(inputs, at.from_torques(INPUTS))
    assert given.ask(at, kept)[1].tolist() == [2.0] * 16
    greeting, first, _ = one.asked
    assert greeting["asks"]["pose"] == [[3], "m, m, rad"]
    assert set(greeting["answers"]) == {*ANSWERS, "memory"}
    assert set(first) == {*ASKS, "memory"} == set(greeting["asks"])
    sizes = {"arms": 2, "gauges": 0, "delay + 1": 1}
    for name, (shape, _) in greeting["asks"].items():
        assert list(np.shape(first[name])) == [sizes.get(n, n) for n in shape], name


class Same(flexlab.OwnLaw):
    """The law that the examples compute."""

    position_gain = gain(2e4, "N/m, N·m/rad", low=0, high=1e6)
    velocity_gain = gain(800.0, "N·s/m, N·m·s/rad", low=0, high=1e5)

    def act(self, at):
        e, e_dot = at.pose - at.desired_pose, at.pose_rate - at.desired_rate
        return at.weights + at.shared(-self.position_gain * e - self.velocity_gain * e_dot)


@contextlib.contextmanager
def example(command: list[str]) -> Iterator[str]:
    """The address at which an example listens while it runs."""
    with subprocess.Popen([*command, "0"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield re.findall(r"tcp://\S+", process.stdout.readline())[0]
        finally:
            process.kill()


@pytest.fixture(params=["py", "c"])
def command(request: pytest.FixtureRequest, root: Path, tmp_path: Path) -> list[str]:
    file = root / f"web_assets/examples/controller.{request.param}"
    if request.param == "py":
        return [sys.executable, str(file)]
    if shutil.which("cc") is None and not os.environ.get("CI"):
        pytest.skip("no C compiler (cc): the example in C is not looked at")
    subprocess.run(["cc", "-std=gnu11", "-Wall", "-Wextra", "-Werror", "-o", tmp_path / "it", file], check=True)
    return [str(tmp_path / "it")]


@pytest.mark.parametrize(("preset", "duration"), [("gravity", 0.1), ("single-arm", 0.002)])
def test_the_examples_drive_the_arms_as_the_same_law_in_python_does(command: list[str], preset: str, duration: float):
    with example(command) as address:
        run = flexlab.simulate(preset, duration, law=address)
        again = flexlab.simulate(preset, duration, law=address)
    same = flexlab.simulate(preset, duration, law=Same)
    assert run.status == "finished"
    np.testing.assert_allclose(run.pose, same.pose, rtol=0, atol=1e-13)
    assert run.result_hash == again.result_hash


def test_a_program_that_leaves_ends_the_run_and_may_serve_the_next_one(program: Callable[..., Program]):
    one = program(lambda at: {"inputs": at["weights"]} if at["time"] < 0.005 or len(one.asked) > 20 else None)
    scenario = load_preset("gravity").replace({"controller.kind": law_kind(one.address)})
    world = World(scenario)
    assert len(world.advance(20)) < 20
    assert world.status.text.startswith(f"The control law {scenario.controller.kind} stopped just after t = 0.00")
    assert f"s. {one.address}: it closed the connection. The last good state" in world.status.text
    assert world.status.text.endswith("is kept. See to that program and start again.")
    while len(one.asked) <= 20:
        one.asked.append({})
    assert len(World(scenario).advance(20)) == 20


def test_a_second_answer_is_not_taken_for_that_to_the_next_message(program: Callable[..., Program]):
    one = program(lambda at: packed({"inputs": at["weights"]}) * (2 if at["time"] > 0.005 else 1))
    run = flexlab.simulate("gravity", 0.1, law=one.address)
    assert len(run) < 20
    assert f"{one.address}: it sent more than one answer to a message." in run.status.text


def test_a_program_that_stops_answering_is_given_up_after_a_second(program: Callable[..., Program]):
    one = program(lambda at: {"inputs": at["weights"]} if at["time"] < 0.005 else b"")
    run = flexlab.simulate("gravity", 0.1, law=one.address)
    assert f"{one.address}: it did not answer within 1 s." in run.status.text


def test_a_run_is_refused_if_no_program_listens_at_the_address():
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
    says = f"{address}: no program answers there (Connection refused): start it, then run this again."
    with pytest.raises(ScenarioError, match=re.escape(says)):
        flexlab.simulate("gravity", 0.1, law=address)


def test_an_unknown_host_is_reported():
    with pytest.raises(ScenarioError, match="no host has such a name: is the address right"):
        flexlab.simulate("gravity", 0.1, law=f"tcp://{'a' * 100}:5000")


def test_neither_scenario_nor_recording_connects_by_itself(
    flexlab_command: Any, tmp_path: Path, program: Callable[..., Program]
):
    one = program(lambda at: {"inputs": at["weights"]})
    done = flexlab_command("run", "gravity", "--law", one.address, "--duration", "0.05")
    assert done.returncode == 0, done.stderr
    allow_no_own_laws()
    recording = flexlab.read(next((tmp_path / "logs").glob("*.rrd")))
    assert address_in(recording.scenario.controller.source) == one.address
    one.asked.clear()
    with pytest.raises(ScenarioError, match=f"is the program at {one.address}, to which flexlab does not connect by"):
        World(recording.scenario)
    again = flexlab_command("replay")
    question = f"by the program at {one.address}, which a replay needs: it has to run there now. Connect to it?"
    assert question in " ".join(again.stderr.split())
    assert again.returncode == 2
    assert one.asked == []
    assert "bit for bit" in flexlab_command("replay", "--run-own-law").stdout
    assert one.asked


def test_a_leaderboard_reuses_no_rows_of_a_program_from_another_process(monkeypatch: pytest.MonkeyPatch):
    address = "tcp://localhost:9000"
    scenarios = [load_preset("paper").replace({"controller.kind": law_kind(law)}) for law in ("pd", address)]
    before = [law_source(one) for one in scenarios]
    monkeypatch.setattr(store, "_THIS_PROCESS", "another")
    after = [law_source(one) for one in scenarios]
    assert (before[0] == after[0], before[1] == after[1]) == (True, False)


def test_a_text_with_additional_code_is_not_taken_for_an_address():
    text = text_of_program("tcp://LocalHost:9000/")
    assert address_in(text) == "tcp://localhost:9000"
    assert address_in(text + "import os\n") == ""
    assert address_in(text.replace("localhost", "elsewhere", 1)) == ""
