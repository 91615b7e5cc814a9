"""Notes on recordings: changes made at the same time are all kept."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from flexlab.recording.store.notes import read_notes, write_notes

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
