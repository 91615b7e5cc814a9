"""One place in this process where rerun viewers watch all runs live, and where late ones still find the last minutes."""

import rerun as rr

from flexlab.errors import LabError, RecordingError
from flexlab.recording.run_info import RunInfo
from flexlab.recording.run_stream import FLUSH_TIMEOUT, RunStream, open_live_stream
from flexlab.sockets import PortInUse, listen

MEMORY_LIMIT = "64MiB"
"""What the hub keeps for viewers that join late: about four minutes of the paper's run. What never changes stays."""

HUB_APPLICATION = "flexlab hub"
"""The hub is itself a (silent) rerun stream: runs come and go, and a port opened anew for each would fail."""

LOOPBACK = "127.0.0.1"
ATTEMPTS = 5
"""Free ports tried before giving up: another program may take one between the question and the answer."""


class LiveHub:
    """Serves the live stream of every run on one port, until `close`."""

    def __init__(self, host: str = LOOPBACK, port: int = 0):
        """Listen on `host` (an IPv4 address); port 0 takes a free one. Raises `RecordingError` if it cannot."""
        self._stream: rr.RecordingStream | None = None
        self.host = host
        for _ in range(1 if port else ATTEMPTS):
            # Rerun tells neither a bad address nor a port in use apart, so both are tried first.
            try:
                plug = listen(host, port)
            except PortInUse:
                self.port = port
                break
            except LabError as error:
                raise RecordingError(str(error)) from None
            self.port = plug.getsockname()[1]
            plug.close()
            if self._listen():
                return
        raise RecordingError(
            f"The live stream cannot listen on {host}:{self.port}: the port is in use. Choose another one, or 0 for any."
        )

    def _listen(self) -> bool:
        stream = rr.RecordingStream(HUB_APPLICATION, send_properties=False)
        try:
            stream.set_sinks(rr.GrpcServerSink(self.host, self.port, server_memory_limit=MEMORY_LIMIT))
            stream.flush(timeout_sec=FLUSH_TIMEOUT)  # Only this tells whether the server stands.
        except (RuntimeError, ValueError, OSError):
            stream.disconnect()
            return False
        self._stream = stream
        return True

    @property
    def url(self) -> str:
        """What a rerun viewer connects to: `rerun --connect <url>`."""
        host = LOOPBACK if self.host == "0.0.0.0" else self.host
        return f"rerun+http://{host}:{self.port}/proxy"

    def open_stream(self, info: RunInfo) -> RunStream:
        """The stream of one run, for all viewers present and to come. Raises `RecordingError` once the hub is closed."""
        if self._stream is None:
            raise RecordingError("The live stream is closed.")
        return open_live_stream(self.url, info)

    def close(self) -> None:
        """Stop serving. Runs that still stream into the hub must be closed first. May be called twice."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.disconnect()
