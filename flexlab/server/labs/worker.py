"""A lab in a separate process: the code that runs in that process, and the server's handle on it."""

import asyncio
import contextlib
import signal
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from operator import methodcaller

from flexlab.errors import FlexlabError, LabError, RecordingError
from flexlab.own.files import know_own_files
from flexlab.recording.live import LiveHub, Take
from flexlab.server.labs import Lab, LabStatus, Order, Request
from flexlab.server.labs.recorded_lab import RecordedLab
from flexlab.server.tasks import failures_told_plainly, job_processes, leave_interrupts_to_the_server, start

STATUS_PERIOD = 0.25
"""Seconds between two reports of a worker whose state changes."""
LONGEST_SILENCE = 1.0
"""Seconds after which it reports even without a change: a worker that is silent for longer hangs."""
START_TIME = 120.0
"""Most seconds for opening a lab: it takes two on a warm machine, and most of a minute if it must compile first."""
STOP_TIME = 15.0
"""Most seconds for closing a recording, after which the worker is killed (and the recording repaired)."""
Word = Callable[[RecordedLab], object] | None
"""The server's message to a worker: what to do with its lab, as an `operator.methodcaller`, or None to close it."""


def _sender(pipe: Connection) -> Take:
    def take(run: str, piece: bytes) -> None:
        try:
            pipe.send((run, piece))
        except OSError:
            raise RecordingError("The live stream is closed.") from None

    return take


@failures_told_plainly()
def work(order: Order, pipe: Connection, live: Connection | None) -> None:
    """The worker's main function: open a lab, report on it, follow messages. Ends on request or with the server."""
    leave_interrupts_to_the_server()
    know_own_files(order.own_files)
    stopping = threading.Event()
    signal.signal(signal.SIGTERM, lambda number, frame: stopping.set())
    try:
        lab = RecordedLab(order, None if live is None else _sender(live))
    except FlexlabError as error:
        pipe.send(str(error))
        return
    # Close the run properly even if the server is gone.
    with contextlib.closing(lab), contextlib.suppress(EOFError, OSError):
        pipe.send(lab.port)
        told: LabStatus | None = None
        told_at = 0.0
        while not stopping.is_set():
            status, now = lab.status(), time.monotonic()
            if status != told or now - told_at > LONGEST_SILENCE:
                pipe.send(status)
                told, told_at = status, now
            if pipe.poll(STATUS_PERIOD):
                word: Word = pipe.recv()
                if word is None:
                    return
                word(lab)


class PrivateLab(Lab):
    """One visitor's lab: the server's handle on its process. Blocking calls are marked; they belong on a thread."""

    def __init__(self, number: int, lab: str, visitor: str, order: Order, on_end: Callable[[], None]):
        """Start the process. `on_end` is called on a thread when the process ends for whatever reason."""
        self.number, self.visitor, self.path = number, visitor, f"/s/{lab}"
        self.secret, self.name, self.owner = order.secret, order.visitor, order.owner
        self.seen = time.monotonic()
        """When the last of its pages was closed, monotonic s."""
        self.why = ""
        """Why the server closes it; empty while it does not."""
        scenario, name = order.choice.scenario, order.choice.name
        self._status = LabStatus(name, scenario.title or name, 0.0, "starting", "", None, "")
        context = job_processes()
        self._pipe, other = context.Pipe()
        source, target = context.Pipe(duplex=False) if order.live else (None, None)
        self.process = context.Process(target=work, args=(order, other, target), name="flexlab-lab", daemon=True)
        start(self.process, *filter(None, (other, target)))
        if source is not None:
            self.live = LiveHub()
            threading.Thread(target=_feed, args=(source, self.live), name="flexlab-live", daemon=True).start()
        self._on_end = on_end
        self._answered = threading.Event()
        self._sending = threading.Lock()
        self._answer: int | str | None = None
        """The worker's first message: the port of its lab, or why the lab could not be opened."""
        self.heard_at = time.monotonic()
        """When the worker last sent anything, monotonic s."""
        self._listener = threading.Thread(target=self._listen, name="flexlab-worker", daemon=True)
        self._listener.start()

    async def ask(self, what: Request) -> None:
        """Pass a request on to the worker."""
        await asyncio.to_thread(self.send, methodcaller("carry_out", what))

    def wait_until_ready(self) -> int:
        """Return the lab's port once it is open. Blocks. Raises `LabError` if it does not open."""
        if not self._answered.wait(START_TIME):
            raise LabError(f"The lab did not open within {START_TIME:g} s: this machine is too busy. Try again later.")
        if isinstance(self._answer, int):
            return self._answer
        if self._answer is not None:
            raise LabError(self._answer)
        raise LabError(f"The lab ended while it was being opened (exit code {self.process.exitcode}): try again.")

    def send(self, word: Word) -> None:
        """Have the worker do something with its lab, or close it."""
        with self._sending, contextlib.suppress(OSError):  # It may have just ended, which the listener notices.
            self._pipe.send(word)

    def stop(self, patience: float) -> None:
        """Close the lab and its recording; kill the process if that takes longer than `patience` s. Blocks."""
        self.send(None)
        self.process.join(patience)
        if self.process.is_alive():
            self.process.kill()
        self._listener.join()

    def _listen(self) -> None:
        try:
            while True:
                word = self._pipe.recv()
                self.heard_at = time.monotonic()
                if isinstance(word, LabStatus):
                    self._status = word
                else:
                    self._answer = word
                    self._answered.set()
        except (EOFError, OSError):
            self.process.join()
            self._answered.set()
            self._on_end()


def _feed(source: Connection, hub: LiveHub) -> None:
    """Pass a worker's live data on to its viewers, until it ends."""
    with contextlib.suppress(EOFError, OSError, RecordingError):
        while True:
            hub.take(*source.recv())
    hub.close()
