"""A logs folder with odd files of every kind around one good run."""

import json
import os
from pathlib import Path

SECRET = b"a secret that lies outside"


def make_odd_folder(logs: Path, recorded: Path) -> None:
    """Fill `logs` with a copy of `recorded` and with odd files that must do no harm."""
    logs.mkdir(parents=True, exist_ok=True)
    (logs / "good.rrd").write_bytes(recorded.read_bytes())
    outside = logs.parent / "outside.txt"
    outside.write_bytes(SECRET)
    (logs / "dangling.rrd").symlink_to(logs / "nowhere")
    (logs / "loop.rrd").symlink_to(logs / "loop.rrd")
    (logs / "link.rrd").symlink_to(outside)
    (logs / "link-to-run.rrd").symlink_to(recorded)
    os.mkfifo(logs / "pipe.rrd")
    (logs / "folder.rrd").mkdir()
    (logs / "text.rrd").write_bytes(SECRET)
    (logs / "empty.rrd").touch()
    for name in (b"name-\xff.rrd", b"line\nbreak.rrd", b"esc\x1b[31m.rrd", b"a?b#c%20d.rrd", b"a{b}.rrd", b"...rrd"):
        (logs / os.fsdecode(name)).write_bytes(recorded.read_bytes())
    notes = {
        "deep": "[" * 100_000,
        "broken": '{"note": ',
        "list": "[1]",
        "bytes": b"\xff\xfe\x00",
        "infinite": '{"duration": 1e999, "begins": -1e999, "metrics": {"RMS error x [mm]": NaN}}',
        "huge": json.dumps({"duration": 1, "begins": 0}).replace("1", "1" + "0" * 4000),
        "surrogate": '{"preset": "\\ud800", "note": "\\udfff", "tags": ["\\ud800"], "changes": ["\\ud800"]}',
        "escapes": json.dumps({"note": "\x1b]0;owned\x07", "tags": ["\x9b31m"], "preset": "\x00", "status": "\x1b[2J"}),
        "kinds": '{"preset": {}, "started": 5, "metrics": [1], "changes": {"a": 1}, "tags": 3, "keep": 0, "rows": "x"}',
    }
    for name, text in notes.items():
        (logs / f"{name}.rrd").write_bytes(recorded.read_bytes())
        (logs / f"{name}.json").write_bytes(text if isinstance(text, bytes) else text.encode())
    (logs / "piped.rrd").write_bytes(recorded.read_bytes())
    os.mkfifo(logs / "piped.json")


RUNS = 25
"""Number of entries `*.rrd` in such a folder."""
