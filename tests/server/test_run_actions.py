"""What can be done with recorded runs, requested without a browser: compare, replay, continue, export, import."""

import io
import json
import os
import re
import shutil
import zipfile
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from aiohttp.multipart import content_disposition_filename, parse_content_disposition
from http_client import ask, compared, looking, over, post, run_apart, upload, wait_until
from rerun.chunk import RrdReader

from flexlab.analysis.replay import replay
from flexlab.errors import LabError
from flexlab.guide import LessonProgress
from flexlab.lab.session import Session
from flexlab.presets import load_preset
from flexlab.recording.export import import_run
from flexlab.recording.headless import HeadlessRecording, write_run
from flexlab.recording.importing import take_measurement
from flexlab.recording.reader import read_recording
from flexlab.recording.run_info import RunInfo
from flexlab.recording.store import run_index
from flexlab.recording.store.notes import read_notes, write_notes
from flexlab.recording.store.run_files import list_files, list_runs, remove_run
from flexlab.recording.store.run_index import find_row
from flexlab.server.front_server import FrontServer
from flexlab.server.limits import THE_SERVER
from flexlab.server.run_jobs import archive_into, compare_runs
from flexlab.server.tasks import Tasks
from flexlab.server.visitors import as_download
from flexlab.sim.commands import Play
from flexlab.sim.simulate import simulate


@pytest.fixture(scope="module")
def softer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 0.3 s with half the stiffness."""
    scenario = load_preset("paper").replace({"payload.bending_stiffness": 50.0})
    started = datetime(2026, 1, 2, 3, 4, 5).astimezone()
    with HeadlessRecording(tmp_path_factory.mktemp("softer"), RunInfo("softer", scenario, started=started)) as made:
        made.write_whole(simulate(scenario, duration=0.3))
    return made.path


@pytest.fixture
def library(open_another: Callable[..., FrontServer], recorded: Path, softer: Path) -> FrontServer:
    """A server with two finished runs."""
    front_server = open_another()
    for run in (recorded, softer):
        shutil.copy(run, front_server.settings.logs / run.name)
        shutil.copy(run.with_suffix(".json"), front_server.settings.logs / run.with_suffix(".json").name)
    return front_server


def test_two_runs_are_compared_in_tables_and_in_one_overlay(library: FrontServer, recorded: Path, softer: Path) -> None:
    assert f'value="{softer.stem}" form="compare"' in ask(library.url, "/runs").text
    place, answer = compared(library.url, recorded.stem, softer.stem)
    page = answer.text
    assert "Metrics <small>of the first 0.3\xa0s of each run</small>" in page
    assert '<th scope="row">Duration (s)</th><td class="number" title="">0.3</td>\n' in page
    assert "not settled</td>" in page
    assert "Residual vibration" not in page, "neither run stops"
    assert "Bending stiffness EI (N·m²)" in page
    address = page.split('data-recording="')[1].split('"')[0]
    overlay = ask(library.url, address)
    assert overlay.status == 200
    file = library.settings.logs / "overlay.out"
    file.write_bytes(overlay.body)
    assert {"/runs/A/error", "/runs/B/error"} <= {chunk.entity_path for chunk in RrdReader(file).stream()}
    assert address in ask(library.url, place).text, "a reload does not compare anew"
    asked_again = ask(library.url, f"/compare?run={recorded.stem}&run={softer.stem}")
    assert asked_again.headers["Location"] == place, "nor does who asks again"


def test_a_comparison_reports_its_progress_and_a_failed_one_its_reason(library: FrontServer, recorded: Path) -> None:
    long = simulate(load_preset("paper"), duration=60.0, sample_period=0.001)
    run = write_run(long, library.settings.logs, "long")
    address = f"/compare?run={recorded.stem}&run={run.stem}"
    place = ask(library.url, address).headers["Location"]
    key = place.rpartition("of=")[2]
    shares: list[float] = []

    def finished() -> bool:
        told = json.loads(ask(library.url, f"/compare/{key}/state").text)
        if told["working"]:
            page = ask(library.url, place).text
            assert f'data-address="/compare/{key}/state"' in page or 'data-recording="' in page
            shares.append(told["share"])
        return not told["working"]

    wait_until(finished, "the comparison is over")
    assert shares == sorted(shares)
    assert any(0 < share < 1 for share in shares)
    assert "Metrics <small>of the first 0.5\xa0s of each run</small>" in ask(library.url, place).text
    assert ask(library.url, "/compare/none/state").status == 404
    write_notes(run, rows=2_000_000)
    place, answer = compared(library.url, run.stem, recorded.stem)
    assert (answer.status, "has 2000000 samples, over 1200000" in answer.text) == (422, True)
    assert ask(library.url, place).status == 422, "a reload does not compare anew"
    again = ask(library.url, place.partition("&of=")[0])
    assert again.status == 303, "who asks again makes it try again"


def test_a_run_is_exported_as_a_lab_sheet_or_an_archive(library: FrontServer, recorded: Path) -> None:
    post(library.url, f"/runs/{recorded.stem}/notes", {"note": "<b>I saw</b> it ring.", "tags": "homework"})
    path = library.settings.logs / recorded.name
    met = LessonProgress("Lesson 1: ring", 3, "How often?", ("12 Hz", "45 Hz"), "45 Hz", "12 Hz", "It rings at 45 Hz.")
    write_notes(path, lessons=[met._asdict(), "no lesson", {"lesson": ["odd"], "step": {}}], visitor="Ada")
    write_notes(path, changes=["payload.bending_stiffness: 100 → 30"])
    page = ask(library.url, f"/runs/{recorded.stem}/export?format=html")
    assert page.status == 200
    for text in ("Ada", "homework", "&lt;b&gt;I saw&lt;/b&gt; it ring.", "How often?", "12 Hz", "It rings at 45 Hz."):
        assert text in page.text, text
    assert "<li>Bending stiffness EI (N·m²): 100 → 30</li>" in page.text, "words, no name in code"
    archive = ask(library.url, f"/runs/{recorded.stem}/export?format=zip")
    with zipfile.ZipFile(io.BytesIO(archive.body)) as whole:
        assert {"run.rrd", "ro-crate-metadata.json"} <= set(whole.namelist())
    refused = ask(library.url, f"/runs/{recorded.stem}/export?format=html&start=0.1")
    assert refused.status == 422
    assert "hold the whole run: leave both times empty" in refused.text


def test_pages_show_a_measurement_as_measured_not_simulated(library: FrontServer, recorded: Path) -> None:
    time = np.arange(0, 0.3, 1e-3)
    ring = 1e-3 * np.exp(-5 * time) * np.cos(280 * time)
    logs = library.settings.logs
    laser = take_measurement(Path("laser.csv"), load_preset("paper"), time, ring, 0 * time, "a laser", logs)
    assert ">measured</span>" in ask(library.url, "/runs").text
    page = ask(library.url, f"/runs/{laser.stem}").text
    assert all(word not in page for word in (f'{laser.stem}/replay"><button', "Continue"))
    assert "Continue" in ask(library.url, f"/runs/{recorded.stem}").text
    page = compared(library.url, laser.stem, recorded.stem)[1].text
    assert "Measured, not simulated: A. Its settings are those of the beam that it is compared with" in page
    assert "All these runs started" not in page
    drawn = {chunk.entity_path for chunk in RrdReader(laser).stream()}
    assert "/vibration" in drawn
    assert not any(path.startswith("/scene/") for path in drawn), "nobody knows where it was"
    overlay = logs / "overlay.out"
    overlay.write_bytes(ask(library.url, page.split('data-recording="')[1].split('"')[0]).body)
    seen = {chunk.entity_path for chunk in RrdReader(overlay).stream()}
    assert {"/runs/A/vibration", "/runs/B/vibration", "/runs/B/scene/links"} <= seen
    assert not any(path.startswith("/runs/A/scene/") for path in seen)


@pytest.mark.parametrize(
    ("query", "status", "says"),
    [
        ("", 400, "Choose 2 to 6 runs to compare: this address names 0."),
        ("?run=a", 400, "this address names 1."),
        ("?" + "&".join(f"run=r{number}" for number in range(7)), 400, "this address names 7."),
        ("?run=../../etc/passwd&run=b", 404, "There is no run"),
    ],
)
def test_an_impossible_comparison_is_refused(front_server: FrontServer, query: str, status: int, says: str) -> None:
    answer = ask(front_server.url, f"/compare{query}")
    assert (answer.status, says in answer.text) == (status, True)


def test_overlays_are_removed_when_the_server_closes(library: FrontServer, recorded: Path, softer: Path) -> None:
    pages = [compared(library.url, one.stem, two.stem)[1] for one, two in ((recorded, softer), (softer, recorded))]
    overlays = [page.text.split('data-recording="')[1].split('"')[0] for page in pages]
    assert [ask(library.url, overlay).status for overlay in overlays] == [200, 200]
    (folder,) = {path.parent.parent for path in library.temporary_folder.glob("*/overlay.rrd")}
    library.close()
    assert not folder.exists()


def test_a_replay_reports_its_finding_and_detects_a_wrong_scenario(
    library: FrontServer, recorded: Path, softer: Path
) -> None:
    assert ask(library.url, f"/runs/{recorded.stem}/replay").status == 404
    assert post(library.url, f"/runs/{recorded.stem}/replay", {}).headers["Location"] == f"/runs/{recorded.stem}"
    assert post(library.url, f"/runs/{recorded.stem}/replay", {}).status == 303, "asked twice, it is still one replay"

    state = over(library.url, f"/runs/{recorded.stem}/replay")
    assert (state["kind"], state["sentence"]) == ("good", "All 501 samples came out again, bit for bit.")
    assert state["sentence"] in ask(library.url, f"/runs/{recorded.stem}").text
    # A run whose scenario is not the one that made its samples.
    run = simulate(load_preset("paper"), duration=0.1)
    changed = type(run)(**vars(run) | {"scenario": run.scenario.replace({"payload.bending_stiffness": 99.0})})
    other = write_run(changed, library.settings.logs, "other")
    post(library.url, f"/runs/{other.stem}/replay", {})
    state = over(library.url, f"/runs/{other.stem}/replay")
    assert state["kind"] == "bad"
    # At t = 0 the sine has no acceleration, so that no stiffness shows.
    assert "differs first at t = 0.001 s in pose" in state["sentence"]


def play(server: FrontServer) -> None:
    """Press Play in the shared lab."""
    session: Session = server.places.laboratory._session  # type: ignore[attr-defined]
    session.lab_state.submit(Play())


def test_the_lab_continues_from_an_instant_and_its_recordings_replay(library: FrontServer, recorded: Path) -> None:
    original = read_recording(recorded)
    answer = post(library.url, f"/runs/{recorded.stem}/continue", {"time": "0.2"})
    assert (answer.status, answer.headers["Location"]) == (303, "/lab/")
    with looking(library.url, "/lab"):
        place = library.places.running()[0]
        wait_until(lambda: (place.status().time, place.status().state) == (0.2, "paused"), "the lab stands at 0.2 s")
        play(library)
        wait_until(lambda: place.status().time > 0.6, "the lab goes on from 0.2 s")
        post(library.url, f"/runs/{recorded.stem}/continue", {})
        wait_until(lambda: len(list_runs(library.settings.logs)) == 5, "a second run goes on from the end")
        wait_until(lambda: (place.status().time, place.status().state) == (0.5, "paused"), "the lab stands at 0.5 s")
        play(library)
        wait_until(lambda: place.status().time > 0.6, "the lab goes on from 0.5 s")
    library.close()
    runs = {read_recording(path).samples.time[0]: path for path in list_runs(library.settings.logs)[:2]}
    assert set(runs) == {0.2, 0.5}
    for begin, path in runs.items():
        found = read_recording(path)
        assert found.name == "paper"
        assert read_notes(path)["changes"] == [f"Go on from {recorded.stem} at t = {begin:.3f} s"]
        row = round(1000 * begin)
        assert found.samples.pose[0].tobytes() == original.samples.pose[row].tobytes()
        common = min(len(found.samples), 501 - row)
        assert found.samples.joint_torque[:common].tobytes() == original.samples.joint_torque[row:][:common].tobytes()
        assert replay(found).identical
        assert read_notes(path)["begins"] == begin


def test_a_run_that_is_being_recorded_is_replayed_as_far_as_it_goes(library: FrontServer) -> None:
    with looking(library.url, "/lab"):
        place = library.places.running()[0]
        play(library)
        wait_until(lambda: place.status().time > 1.5, "a second is recorded")
        recording = place.status().recording
        assert recording is not None
        run = recording.stem
        assert post(library.url, f"/runs/{run}/replay", {}).status == 303
        sentence = over(library.url, f"/runs/{run}/replay")["sentence"]
        assert re.fullmatch(r"All \d+ samples came out again, bit for bit\.", sentence)
        assert sentence in ask(library.url, f"/runs/{run}").text, "although the file has grown since"


@pytest.mark.parametrize(
    ("time", "says"),
    [
        ("0.6", "t\xa0=\xa00.6\xa0s was not recorded: choose 0 to 0.5\xa0s."),
        ("-1", "t\xa0=\xa0−1\xa0s was not recorded"),
        ("soon", "time = &#x27;soon&#x27; is not a time: give a number of seconds"),
        ("nan", "is not a time"),
    ],
)
def test_continuing_from_a_time_outside_the_run_is_refused(
    library: FrontServer, recorded: Path, time: str, says: str
) -> None:
    answer = post(library.url, f"/runs/{recorded.stem}/continue", {"time": time})
    assert (answer.status, says in answer.text) == (422, True)
    assert f'href="/runs/{recorded.stem}"' in answer.text
    assert library.places.running()[0].status().name == "paper"


@pytest.mark.parametrize("name", ['a "good" run.csv', "größe.zip", "back\\slash.npz", "two\nlines.csv"])
def test_a_download_has_the_name_of_its_file_whatever_its_characters(name: str) -> None:
    kind, given = parse_content_disposition(as_download(name))
    assert (kind, content_disposition_filename(given)) == ("attachment", name.replace("\n", " "))


def test_an_export_imported_again_is_the_run_bit_for_bit(library: FrontServer, softer: Path, tmp_path: Path) -> None:
    kind = "parquet"
    answer = ask(library.url, f"/runs/{softer.stem}/export?format={kind}")
    assert answer.headers["Content-Disposition"] == f'attachment; filename="{softer.stem}.{kind}"'
    assert len(answer.body) == int(answer.headers["Content-Length"])
    taken = upload(library.url, f"{softer.stem}.{kind}", answer.body)
    assert (taken.status, taken.headers["Location"]) == (303, f"/runs/{softer.stem}-2")
    found, original = read_recording(library.settings.logs / f"{softer.stem}-2.rrd"), read_recording(softer)
    for name in vars(original.samples):
        assert getattr(found.samples, name).tobytes() == getattr(original.samples, name).tobytes(), name
    assert (found.scenario, found.name, found.started) == (original.scenario, original.name, original.started)
    assert "100 → 50" not in ask(library.url, "/runs").text, "softer is not a preset"
    assert "metrics" in read_notes(found.path)
    # A range of time.
    part = ask(library.url, f"/runs/{softer.stem}/export?format=csv&start=0.1&end=0.2")
    path = tmp_path / "part.csv"
    path.write_bytes(part.body)
    run, _ = import_run(path)
    assert (run.time[0], run.time[-1], len(run)) == (0.1, 0.2, 101)


def test_figures_are_exported_in_one_archive(library: FrontServer, softer: Path) -> None:
    answer = ask(library.url, f"/runs/{softer.stem}/export?format=svg&start=0.1")
    assert "figures-svg.zip" in answer.headers["Content-Disposition"]
    with zipfile.ZipFile(io.BytesIO(answer.body)) as archive:
        names = archive.namelist()
        assert [name.rpartition("-")[2] for name in names] == ["2.svg", "3.svg", "4.svg", "5.svg"]
        assert all(archive.read(name).startswith(b"<?xml") for name in names)


@pytest.mark.parametrize(
    ("query", "says"),
    [
        (
            "format=xlsx",
            "format = &#x27;xlsx&#x27; is not known: choose one of html, zip, csv, parquet, npz, png, svg.",
        ),
        ("format=csv&start=2", "From 2 to 0.5\xa0s there is no sample: choose times within 0 to 0.5\xa0s"),
        ("format=csv&end=inf", "end = &#x27;inf&#x27; is not a time"),
    ],
)
def test_an_impossible_export_is_refused(front_server: FrontServer, recorded: Path, query: str, says: str) -> None:
    answer = ask(front_server.url, f"/runs/{recorded.stem}/export?{query}")
    assert (answer.status, says in answer.text) == (422, True)


def test_pages_of_other_sites_cannot_start_work_on_the_server(front_server: FrontServer, recorded: Path) -> None:
    for path in (f"/runs/{recorded.stem}/export?format=csv", f"/compare?run={recorded.stem}&run={recorded.stem}"):
        assert ask(front_server.url, path, Sec_Fetch_Dest="image").status == 403
    for path in (f"/runs/{recorded.stem}/replay", f"/runs/{recorded.stem}/continue", "/runs/import"):
        assert ask(front_server.url, path, "POST", b"", Origin="http://evil.example").status == 403


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("run.rrd", b"RRF2" + b"garbage" * 99, "is damaged beyond repair"),
        ("run.rrd", b"", "is empty"),
        ("run.csv", b"a,b\n1,2\n", "run.csv is not a run exported by flexlab"),
        ("run.npz", b"PK\x03\x04garbage", "run.npz is not a run exported by flexlab"),
        ("../../run.parquet", b"PAR1", "run.parquet is not a run exported by flexlab"),
        (
            "run.zip",
            b"PK",
            "run.zip has no known format: choose a file that ends in .rrd, .csv, .parquet, .npz. From an archive, take run.rrd.",
        ),
        ("run.exe", b"MZ", "run.exe has no known format: choose a file that ends in .rrd, .csv, .parquet, .npz."),
    ],
)
def test_an_upload_that_is_no_run_is_refused(front_server: FrontServer, name: str, content: bytes, says: str) -> None:
    runs, files = list_runs(front_server.settings.logs), set(front_server.temporary_folder.iterdir())
    answer = upload(front_server.url, name, content)
    assert (answer.status, says in answer.text) == (422, True), answer.text
    assert list_runs(front_server.settings.logs) == runs
    assert set(front_server.temporary_folder.iterdir()) <= files, "nothing of it is left"


def test_an_upload_without_a_file_and_one_that_is_too_large_are_refused(front_server: FrontServer) -> None:
    assert "choose one first" in post(front_server.url, "/runs/import", {}).text
    assert "choose one first" in upload(front_server.url, "", b"").text
    two = b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.csv"\r\n\r\n1\r\n' * 2 + b"--b--\r\n"
    said = ask(front_server.url, "/runs/import", "POST", two, Content_Type="multipart/form-data; boundary=b")
    assert "This upload has more than one file: choose one." in said.text
    said = ask(front_server.url, "/runs/import", "POST", b"", Content_Type="multipart/form-data; boundary=b",
               Content_Length="2000000000")  # fmt: skip
    assert "This file is larger than 1\xa0GB" in said.text


def test_a_file_that_claims_to_hold_more_than_it_does_is_refused(front_server: FrontServer, tmp_path: Path) -> None:
    # It claims to hold 8 GB, and holds 8 MB.
    path = tmp_path / "bomb.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("flexlab.npy", "w", force_zip64=True) as file,
    ):
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (1_000_000_000,)})
        for _ in range(8):
            file.write(bytes(1_000_000))
    answer = upload(front_server.url, path.name, path.read_bytes())
    assert answer.status == 422
    assert "is not a run exported by flexlab" in answer.text


def test_a_run_deleted_before_a_task_reads_it_is_one_sentence(
    library: FrontServer, recorded: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Between the choice and the task's turn, somebody else may delete it: that was a traceback on the terminal."""
    row = find_row(library.settings.logs, recorded.stem)
    remove_run(row.path)
    jobs = (compare_runs, (row.path, row.path), tmp_path), (archive_into, (row,), "rrd", tmp_path)
    for work, *arguments in jobs:
        with pytest.raises(LabError, match=f"{recorded.stem} is not there any more: somebody has deleted or moved it"):
            run_apart(Tasks().run(THE_SERVER, work, *arguments))
    os.mkfifo(row.path)  # Reading it would never end.
    for work, *arguments in jobs:
        with pytest.raises(LabError, match="cannot be read: it is a pipe; name an ordinary file"):
            run_apart(Tasks().run(THE_SERVER, work, *arguments))
    assert capfd.readouterr().err == ""


def test_runs_are_tagged_all_or_none(
    open_another: Callable[..., FrontServer], recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    front_server = open_another()
    looks: list[Path] = []
    monkeypatch.setattr(run_index, "list_files", lambda logs: looks.append(logs) or list_files(logs))
    runs = [Path(shutil.copy(recorded, tmp_path / "logs" / f"2025-01-01T12-00-0{k}-paper.rrd")) for k in range(2)]
    write_notes(runs[1], tags=["x" * 190])
    chosen = [("run", run.stem) for run in runs]
    refused = post(front_server.url, "/runs/tag", [*chosen, ("tags", "a new word")])
    said = f"No run was tagged: the tags of {runs[1].stem} would have 201 characters, and at most 200 fit."
    assert (refused.status, said in refused.text) == (400, True)
    assert not read_notes(runs[0]).get("tags")
    assert len(looks) == 1, "500 of 10,000 runs took two minutes with a look for each"
    assert post(front_server.url, "/runs/tag", [*chosen, ("tags", "new")]).status == 303
    assert [read_notes(run)["tags"][-1] for run in runs] == ["new", "new"]
