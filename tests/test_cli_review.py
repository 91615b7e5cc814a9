"""`flexlab review` serves a recording to the rerun viewer, the newest by default, or says why it cannot."""

import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest
import rerun as rr
from lab_process import Command, refused

from flexlab.recording.store.run_files import find_run
from flexlab.recording.viewer import review


def showing(folder: Path, *words: str) -> list[str]:
    """Start a command that opens the viewer, read the page it names, end it as Ctrl-C would, and return its output."""
    with subprocess.Popen(
        [sys.executable, "-u", "-m", "flexlab", *words, "--no-browser"],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout
        assert process.stderr
        lines = []
        for line in process.stdout:
            lines.append(line)
            if line.startswith("Ctrl-C"):
                break
        page = re.search(r"http://127\.0\.0\.1:\d+/", "".join(lines))
        if page is None:
            process.kill()
            raise AssertionError(f"{lines} {process.stderr.read()}")
        with urllib.request.urlopen(page[0]) as answer:
            assert answer.status == 200
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
        assert process.stderr.read() == ""
    return lines


def test_the_newest_or_a_named_or_a_torn_recording_opens(flexlab_command: Command, tmp_path: Path):
    for name in ("paper", "smooth-start"):
        assert flexlab_command("run", name, "--duration", "0.5").returncode == 0
    older, newer = sorted((tmp_path / "logs").glob("*.rrd"), key=lambda path: path.stat().st_mtime_ns)
    assert newer.name in showing(tmp_path, "review")[0]
    for name in (str(older), older.stem[:-3]):
        found = find_run(name, tmp_path / "logs")
        assert found == older
        with review(found) as address:
            assert urllib.request.urlopen(address).status == 200
    torn = tmp_path / "torn.rrd"
    torn.write_bytes(newer.read_bytes()[:-20_000])
    assert "torn.rrd" in showing(tmp_path, "review", "torn.rrd")[0]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "no recording in logs"),
        (["--logs", "nowhere"], "no recording in nowhere"),
        (["none.rrd"], "no recording none.rrd"),
        (["empty.rrd"], "empty"),
        (["junk.rrd"], "not a rerun recording"),
        (["header.rrd"], "header.rrd"),
        (["other.rrd"], "not one of flexlab's"),
        (["."], "cannot be read"),
    ],
)
def test_an_unreadable_recording_is_one_sentence(flexlab_command: Command, tmp_path: Path, words: list[str], says: str):
    (tmp_path / "empty.rrd").touch()
    (tmp_path / "junk.rrd").write_bytes(b"junk" * 1000)
    (tmp_path / "header.rrd").write_bytes(b"RRF2" + bytes(40))
    with rr.RecordingStream("another program") as stream:
        stream.save(tmp_path / "other.rrd")
        stream.log("curve", rr.Scalars(1.0))
    assert says in refused(flexlab_command("review", "--no-browser", *words))
