"""Notes on recordings: changes made at the same time are all kept, and other files stay as they are."""

import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from flexlab.errors import RecordingError
from flexlab.recording.headless import write_run
from flexlab.recording.store.notes import read_notes, write_notes
from flexlab.recording.store.run_files import remove_run
from flexlab.recording.store.run_index import annotate_run, read_row
from flexlab.sim.samples import Run

ELSEWHERE = """
import sys
from pathlib import Path
from flexlab.recording.store.notes import write_notes
for number in range(60):
    write_notes(Path(sys.argv[1]), **{f"{sys.argv[2]}-{number}": number})
"""


def test_changes_by_many_threads_and_processes_at_once_are_all_kept(tmp_path: Path) -> None:
    run = tmp_path / "run.rrd"
    write_notes(run, owner="anna")
    others = [subprocess.Popen([sys.executable, "-c", ELSEWHERE, str(run), f"process-{k}"]) for k in range(2)]
    with ThreadPoolExecutor(8) as threads:
        changes = [threads.submit(write_notes, run, **{f"thread-{number}": number}) for number in range(200)]
        seen = [read_notes(run).get("owner") for _ in range(200)]
    for change in changes:
        change.result()
    assert [other.wait() for other in others] == [0, 0]
    assert set(seen) == {"anna"}, "whoever reads meanwhile finds whole notes"
    wanted = {"owner", *(f"thread-{k}" for k in range(200)), *(f"process-{p}-{k}" for p in (0, 1) for k in range(60))}
    assert set(read_notes(run)) == wanted
    assert [path.name for path in tmp_path.iterdir()] == ["run.json"]


@pytest.mark.parametrize("text", ['{"title": "Mine", "gravity": 1.0}', "[1, 2]"])
def test_another_file_in_the_place_of_the_notes_stays_as_it_is(run: Run, text: str, tmp_path: Path) -> None:
    """A scenario mine.json was changed into notes by saving a run as mine.rrd, and deleted with that run."""
    mine, recording = tmp_path / "mine.json", tmp_path / "mine.rrd"
    mine.write_text(text)
    with pytest.raises(RecordingError, match=r"mine\.json beside it holds something else\): give another name"):
        write_run(run, recording, "paper")
    shutil.copy(write_run(run, tmp_path / "logs", "paper"), recording)
    with pytest.raises(RecordingError, match=r"cannot be written \(mine\.json beside it holds something else"):
        annotate_run(read_row(recording), note="a note")
    remove_run(recording)
    assert (mine.read_text(), recording.exists()) == (text, False)
