"""Rerun's streams, begun and given up so that nothing of them is left: a lab begins one for each run."""

from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun_bindings import flush_and_cleanup_orphaned_recordings


def new_stream(application: str, run_id: str | None = None) -> rr.RecordingStream:
    """A stream without properties of rerun's own; `application`: whose layouts a person's changes hold for."""
    # As `rerun.init` does: a stream that nobody has any more keeps two threads and a megabyte.
    flush_and_cleanup_orphaned_recordings()
    stream = rr.RecordingStream(application, recording_id=run_id, send_properties=False)
    # Wall-clock axes would only be a second, jumpy time beside the simulation's own.
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    return stream


class _Layout:
    """A layout that tells by which stream rerun sends it."""

    def __init__(self, layout: rrb.Blueprint):
        self._layout, self.streams = layout, list[rr.RecordingStream]()

    def to_blueprint(self) -> "_Layout":
        return self

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self.streams.append(stream)
        self._layout._log_to_stream(stream)


def send_layout(stream: rr.RecordingStream, layout: rrb.Blueprint) -> None:
    """Send a layout, to be shown at once."""
    sent: Any = _Layout(layout)
    stream.send_blueprint(sent, make_active=True, make_default=True)
    for each in sent.streams:  # Connected it would hold itself, and never end.
        each.disconnect()
