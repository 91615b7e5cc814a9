"""A recording is mended, then served to this machine's browser with the viewer's own files, or refused with a reason."""

import socket
import sys
import urllib.error
import urllib.request
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest
from recording_helpers import wait_until

from flexlab.errors import LabError, RecordingError
from flexlab.presets import load_preset
from flexlab.recording.recorder import Recorder
from flexlab.recording.store.run_files import find_run, has_footer, run_state
from flexlab.recording.viewer import VIEWER_FILES, review, serving_viewer, viewer_folder
from flexlab.sim.world import World


def test_the_newest_recording_is_opened_and_mended_first(recording_file: Path, tmp_path: Path) -> None:
    recording_file.write_bytes(recording_file.read_bytes()[:-200])
    assert not has_footer(recording_file)
    assert find_run("newest", tmp_path) == recording_file
    with review(recording_file) as address:
        assert has_footer(recording_file)
        answer = urllib.request.urlopen(address)
        assert "default-src 'self'" in answer.headers["Content-Security-Policy"]


@pytest.mark.skipif(sys.platform == "darwin", reason="macOS has one loopback address only")
def test_a_page_whose_host_name_leads_to_this_machine_cannot_find_the_data(recording_file: Path) -> None:
    """The server that serves recordings piece by piece ignores the host name and would read any recording for anyone."""
    found: set[str] = set()
    for _ in range(3):
        with review(recording_file) as address:
            (source,) = parse_qs(urlsplit(address).query)["url"]
            place = urlsplit(source)
            assert place.hostname
            assert place.port
            found.add(place.hostname)
            with socket.create_connection((place.hostname, place.port)), pytest.raises(ConnectionRefusedError):
                socket.create_connection(("127.0.0.1", place.port))
            policy = urllib.request.urlopen(address).headers["Content-Security-Policy"]
            assert f"connect-src 'self' http://{place.netloc} data: blob:" in policy
    assert len(found) == 3


def test_a_run_that_is_being_recorded_opens_without_a_warning(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    world = World(load_preset("paper"))
    recorder = Recorder(tmp_path)
    recorder.begin_run(1, "paper", world.scenario, world.state())
    recorder.take_samples(1, world.advance(300), 1.0)
    wait_until(lambda: recorder.path and recorder.path.stat().st_size > 150_000, "something is recorded")
    path = recorder.path
    assert path is not None
    with review(path) as address:
        assert run_state(path) == "in use"
        assert urllib.request.urlopen(address).status == 200
    recorder.close()
    assert [str(warning.message) for warning in recwarn.list] == []


def test_what_cannot_be_reviewed_is_refused_with_a_reason(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="There is no recording in"):
        find_run("newest", tmp_path)
    with pytest.raises(RecordingError, match="There is no recording"), review(tmp_path / "x.rrd"):
        pass
    (tmp_path / "x.rrd").write_text("no recording")
    with pytest.raises(RecordingError, match="is not a rerun recording"), review(tmp_path / "x.rrd"):
        pass


def test_the_viewer_serves_its_own_files_only() -> None:
    with serving_viewer() as page:
        for name, kind in VIEWER_FILES.items():
            answer = urllib.request.urlopen(page + name)
            assert answer.headers["Content-Type"] == kind
            assert answer.read() == (viewer_folder() / name).read_bytes()
        for name in ("../flexlab/__init__.py", "%2e%2e/x", "etc/passwd", "re_viewer.js/"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(page + name)
        port = urlsplit(page).port
        assert port is not None
        for host in ("evil.example", "[::::]", "[", ""):
            with pytest.raises(urllib.error.HTTPError, match="403"):
                urllib.request.urlopen(urllib.request.Request(page, headers={"Host": host}))
        refused = pytest.raises(LabError, match=f"port {port} is in use by another program")
        with refused, serving_viewer(port):
            pass


def test_the_viewers_page_loads_no_fonts_from_google() -> None:
    page = (viewer_folder() / "index.html").read_text()
    assert "fonts.googleapis.com" not in page
