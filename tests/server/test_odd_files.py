"""Odd files in the logs folder of a real server: each is listed by itself, none harms the others or leads outside."""

import io
import json
import re
import zipfile
from collections.abc import Callable
from html import unescape
from pathlib import Path

import pytest
from http_client import ask, compared, post, upload, wait_until
from odd_files import RUNS, SECRET, make_odd_folder

from flexlab.recording.export import export_recording
from flexlab.recording.reader import read_recording
from flexlab.server.front_server import FrontServer

REFUSED = ("dangling", "loop", "link", "link-to-run", "pipe", "folder", "text", "empty")


@pytest.fixture
def odd(open_another: Callable[..., FrontServer], recorded: Path, tmp_path: Path) -> FrontServer:
    """A server over a folder of odd files."""
    opened = open_another()
    make_odd_folder(tmp_path / "logs", recorded)
    return opened


def test_each_odd_file_is_listed_and_harms_no_other(odd: FrontServer, recorded: Path) -> None:
    assert ask(odd.url, "/").status == 200
    library = ask(odd.url, "/runs")
    assert library.status == 200
    places = set(re.findall(r'<td data-key="[^"]*"><a href="(/runs/[^"]+)"', library.text))
    assert len(places) in (RUNS, RUNS + 1, RUNS + 2), "the lab's own run may stand there too"
    for place in map(unescape, places):
        page = ask(odd.url, place)
        name = place.removeprefix("/runs/")
        assert page.status == (422 if name in REFUSED else 200), (place, page.text)
        file = ask(odd.url, place + ".rrd")
        assert file.status == (404 if name in REFUSED else 200), place
        assert (SECRET in file.body, file.body[:4] == b"RRF2") == (False, name not in REFUSED), place
    for reason in ("is a link", "it is a pipe", "it is a folder", "is not a rerun recording", "is empty"):
        assert reason in library.text, reason
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f]", library.text), "no control character goes out"
    assert ask(odd.url, "/runs/good.rrd").body == recorded.read_bytes()


def test_what_is_no_recording_cannot_be_exported_replayed_continued_or_compared(odd: FrontServer) -> None:
    for name in REFUSED:
        assert ask(odd.url, f"/runs/{name}/export?format=csv").status == 400, name
        for action in ("replay", "continue"):
            said = ask(odd.url, f"/runs/{name}/{action}", "POST", b"", Origin=odd.url)
            assert (said.status, "<p>" in said.text) == (400, True), (name, action)
        assert ask(odd.url, f"/compare?run=good&run={name}").status == 422, name


def test_runs_are_compared_and_exported_whatever_their_notes_say(odd: FrontServer) -> None:
    for name, rows in {"word": "x", "negative": -501, "infinite": float("inf"), "list": [501]}.items():
        (odd.settings.logs / f"{name}.rrd").write_bytes((odd.settings.logs / "good.rrd").read_bytes())
        (odd.settings.logs / f"{name}.json").write_text(json.dumps({"rows": rows}))
        _, page = compared(odd.url, "good", name)
        assert page.status == 200, page.text
        assert ask(odd.url, f"/runs/{name}/export?format=zip").status == 200


def test_recordings_of_any_name_come_in_one_archive(odd: FrontServer) -> None:
    """A name that is no text was a traceback on the terminal."""
    runs = sorted(("name-%FF%2Errd", "line%0Abreak%2Errd", "good", "escapes"))
    archive = post(odd.url, "/runs/export", [("format", "rrd"), *(("run", run) for run in runs)])
    names = zipfile.ZipFile(io.BytesIO(archive.body)).namelist()
    assert sorted(names) == sorted([*(f"{run}.rrd" for run in runs), "escapes.json"])


def test_an_odd_file_can_be_deleted_and_nothing_else_goes(odd: FrontServer, recorded: Path) -> None:
    logs = odd.settings.logs
    for name in ("dangling", "link", "pipe", "text"):
        assert ask(odd.url, f"/runs/delete?run={name}").status == 200
        assert post(odd.url, "/runs/delete", {"run": name, "sure": "yes"}).status == 303
        assert not (logs / f"{name}.rrd").is_symlink()
        assert not (logs / f"{name}.rrd").exists()
    assert (logs.parent / "outside.txt").read_bytes() == SECRET
    assert recorded.exists()


@pytest.mark.parametrize("time", ["-inf", "nan", "1e300"])
def test_a_table_with_impossible_times_is_refused_and_harms_no_page(
    odd: FrontServer, recorded: Path, tmp_path: Path, time: str
) -> None:
    path = export_recording(read_recording(recorded), tmp_path / "x.csv")
    about, heads, first, *rest = path.read_text().splitlines(keepends=True)
    changed = f"{time},{first.partition(',')[2]}"
    answer = upload(odd.url, "x.csv", "".join([about, heads, changed, *rest]).encode())
    assert answer.status == 422
    assert f"x.csv, row 1: time = {float(time):.12g} s" in answer.text.replace("\N{NO-BREAK SPACE}", " ")
    for page in ("/", "/runs"):
        assert ask(odd.url, page).status == 200
    wait_until(lambda: ask(odd.url, "/lab/").status == 200, "the lab is there")
