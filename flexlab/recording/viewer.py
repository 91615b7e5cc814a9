"""Opens recordings in rerun's viewer, in the browser: served piece by piece, so that an hour opens as fast as a minute."""

from pathlib import Path
from types import TracebackType

import rerun.blueprint as rrb

from flexlab.errors import RecordingError
from flexlab.recording import overlay
from flexlab.recording.blueprint import run_blueprint
from flexlab.recording.reader import read_scenarios
from flexlab.recording.repair import finish
from flexlab.recording.rerun_internals.catalog import serve
from flexlab.recording.run_stream import APPLICATION
from flexlab.recording.scene_log import exaggeration
from flexlab.recording.store.run_files import check_recording
from flexlab.recording.web_viewer import LOOPBACK, ViewerServer, viewer_link


class Review:
    """A recording being served to the web viewer on this machine, until `close`."""

    def __init__(self, path: Path, port: int = 0):
        """Serve; `port` of the viewer, 0 for a free one. Raises `RecordingError`."""
        self.path = path
        application, layout = _layout_of(path)
        self._viewer = ViewerServer(LOOPBACK, port)
        try:
            self._server, source = serve(path, application, layout)
        except (RuntimeError, ValueError, OSError, LookupError) as error:
            self._viewer.close()
            reason = str(error).split("\n")[0]
            raise RecordingError(f"{path} cannot be served to the viewer: {reason}") from None
        self.url = viewer_link(self._viewer.page, source)

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._viewer.close()

    def __enter__(self) -> "Review":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_review(path: Path, port: int = 0) -> Review:
    """Serve a recording, or a comparison of some, for a browser to open at the `Review`'s `url`.

    A recording that its writer left without an end is mended first. The caller keeps the `Review` for as long as it is to
    be seen. Raises `RecordingError` if there is nothing that can be read.
    """
    check_recording(path)
    finish(path)
    return Review(path, port)


def _layout_of(path: Path) -> tuple[str, rrb.Blueprint]:
    """(application, layout) of a file. Raises `RecordingError`."""
    runs = read_scenarios(path)
    if len(runs) == 1:
        name, scenario = runs[0]
        return APPLICATION, run_blueprint(scenario, exaggeration(scenario), name)
    return overlay.APPLICATION, overlay.comparison_blueprint(runs)
