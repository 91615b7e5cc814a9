"""Archives of a run that another machine can verify: data, scenario, commands, versions, figures and RO-Crate metadata.

RO-Crate 1.1 (https://w3id.org/ro/crate/1.1): `ro-crate-metadata.json` describes every file of the archive with its SHA-256.
"""

import hashlib
import json
import shutil
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from flexlab.analysis.figures import paper_figures
from flexlab.analysis.metrics import run_metrics
from flexlab.analysis.replay import own_texts
from flexlab.analysis.result import result_hash
from flexlab.errors import RecordingError
from flexlab.files import check_ordinary, packed_sizes, read_packed, writing
from flexlab.presets import scenario_text
from flexlab.recording.codec import command_values
from flexlab.recording.export import export_recording
from flexlab.recording.reader import Recording, read_recording
from flexlab.recording.run_info import PACKAGES, these_versions
from flexlab.recording.store.run_files import find_run
from flexlab.recording.store.run_index import size_text

METADATA, RUN = "ro-crate-metadata.json", "run.rrd"
SPECIFICATION = "https://w3id.org/ro/crate/1.1"
LICENSE = "https://spdx.org/licenses/MIT"
LARGEST_METADATA, LARGEST_ARCHIVE = 10_000_000, 50_000_000_000
"""Largest unpacked sizes of an archive's metadata and of all its files, bytes."""
KINDS = {
    RUN: ("application/octet-stream", "The recording: every sample, bit for bit"),
    "samples.parquet": ("application/vnd.apache.parquet", "Every signal as a table, units in the columns' names"),
    "scenario.json": ("application/json", "The scenario from which the run started"),
    "commands.json": ("application/json", "What a person did in the run, with its times in s"),
    "versions.json": ("application/json", "What computed the samples, and what made this archive"),
    "metrics.json": ("application/json", "Metrics, SI units, and the hash of the result"),
    "path.py": ("text/x-python", "The source of the path, which came with the scenario"),
    "law.py": ("text/x-python", "The source of the control law, which came with the scenario"),
}


def write_capsule(source: Path, target: Path) -> None:
    """Write the recording `source` as an archive, whole or not at all. Raises `RecordingError` or `StudyError`."""
    recording = read_recording(source)
    with writing(target) as draft, TemporaryDirectory(prefix="flexlab-") as place:
        folder = Path(place)
        _fill(folder, source, recording)
        files = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
        described = json.dumps(_metadata(folder, files, recording), indent=1, ensure_ascii=False)
        with zipfile.ZipFile(draft, "w") as archive:
            # Without a date, so that the same run gives the same bytes.
            archive.writestr(zipfile.ZipInfo(METADATA), described, zipfile.ZIP_DEFLATED)
            for name in files:
                archive.writestr(zipfile.ZipInfo(name), (folder / name).read_bytes(), zipfile.ZIP_DEFLATED)


def _fill(folder: Path, source: Path, recording: Recording) -> None:
    shutil.copyfile(source, folder / RUN)
    export_recording(recording, folder / "samples.parquet")
    commands = [
        {"time": event.time, "text": event.text, "command": command_values(event.command)}
        for event in recording.events
        if event.command is not None
    ]
    recorded = {
        name: recording.properties[name] for name in (*these_versions(), PACKAGES) if name in recording.properties
    }
    metrics = run_metrics(recording.samples, finished=not recording.status.failed).as_data()
    documents = {
        "scenario.json": json.loads(scenario_text(recording.scenario)),
        "commands.json": commands,
        "versions.json": {"recorded_by": recorded, "archived_by": these_versions()},
        "metrics.json": {**metrics, "result_hash": result_hash(recording.samples)},
    }
    for name, data in documents.items():
        text = json.dumps(data, indent=1, ensure_ascii=False, default=str) + "\n"
        (folder / name).write_text(text, encoding="utf-8")
    if len(recording.samples):
        paper_figures(recording.samples, folder / "figures", ["svg"])
    for name, part in (("law.py", "controller"), ("path.py", "trajectory")):
        if texts := own_texts(recording, part):
            (folder / name).write_text("\n\n".join(texts), encoding="utf-8")


def _metadata(folder: Path, files: list[str], recording: Recording) -> dict[str, Any]:
    described = [_file(folder, name) for name in files]
    program = {
        "@id": "https://pypi.org/project/flexlab/",
        "@type": "SoftwareApplication",
        "name": "flexlab",
        "version": str(recording.properties.get("flexlab_version", "unknown")),
    }
    action = {
        "@id": "#run",
        "@type": "CreateAction",
        "name": recording.status.text,
        "startTime": recording.started.isoformat(),
        "instrument": {"@id": program["@id"]},
        "object": [{"@id": "scenario.json"}, {"@id": "commands.json"}],
        "result": [{"@id": RUN}],
    }
    root = {
        "@id": "./",
        "@type": "Dataset",
        "name": recording.scenario.title or recording.name,
        "description": recording.scenario.watch or f"A run of {recording.name}",
        "datePublished": recording.started.date().isoformat(),
        "license": {"@id": LICENSE},
        "hasPart": [{"@id": item["@id"]} for item in described],
        "mentions": [{"@id": "#run"}],
    }
    conforms = {"conformsTo": {"@id": SPECIFICATION}, "about": {"@id": "./"}}
    descriptor = {"@id": METADATA, "@type": "CreativeWork", **conforms}
    return {"@context": f"{SPECIFICATION}/context", "@graph": [descriptor, root, program, action, *described]}


def _file(folder: Path, name: str) -> dict[str, Any]:
    data = (folder / name).read_bytes()
    figure = ("image/svg+xml", f"Figure {name[-5]} of the paper, of this run")
    kind, about = KINDS.get(name, figure)
    digest = hashlib.sha256(data).hexdigest()
    return {
        "@id": name, "@type": "File", "name": about, "encodingFormat": kind, "contentSize": str(len(data)), "sha256": digest,
    }  # fmt: skip


def unpack_capsule(archive_path: Path, folder: Path) -> Path:
    """Verify every file of an archive against its metadata, and unpack the recording. Raises `RecordingError`.

    Nothing in the archive is executed.
    """
    try:
        check_ordinary(archive_path)
        with zipfile.ZipFile(archive_path) as archive:
            sizes = packed_sizes(archive)
            _check_size(f"{archive_path}: {METADATA}", sizes.get(METADATA, 0), LARGEST_METADATA)
            _check_size(f"{archive_path}, unpacked,", sum(sizes.values()), LARGEST_ARCHIVE)
            if METADATA not in sizes:
                raise RecordingError(f"{archive_path} is not an archive of a run: it has no {METADATA}.")
            described = {
                item["@id"]: item["sha256"]
                for item in json.loads(read_packed(archive, METADATA))["@graph"]
                if item.get("@type") == "File"
            }
            if RUN not in described:
                raise RecordingError(f"{archive_path} is not an archive of a run: it does not describe {RUN}.")
            free = f"are free in {folder.parent}: make room, or set TMPDIR to another folder"
            _check_size(f"{archive_path}: {RUN}", sizes.get(RUN, 0), shutil.disk_usage(folder).free, free)
            for name, digest in described.items():
                if name not in sizes or _digest(archive, name, folder) != digest:
                    changed = f"{name!r:.80} was changed or is missing"
                    raise RecordingError(f"{archive_path}: {changed}: get the archive again.")
    except RecordingError:
        raise
    except FileNotFoundError:
        raise RecordingError(f"There is no file {archive_path}: check the name.") from None
    except Exception as error:  # Reading a damaged archive raises many kinds of errors.
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise RecordingError(f"{archive_path} cannot be read as an archive of a run ({reason:.120}).") from None
    return folder / RUN


@contextmanager
def opened_run(run: str, logs: Path) -> Iterator[Path]:
    """The path of a run's recording; one in an archive (.zip) is verified, and unpacked meanwhile. Raises `RecordingError`."""
    if not run.lower().endswith(".zip"):
        yield find_run(run, logs)
        return
    with TemporaryDirectory(prefix="flexlab-") as folder:
        yield unpack_capsule(Path(run), Path(folder))


def _check_size(what: str, size: int, most: float, held: str = "are unpacked") -> None:
    """Raise `RecordingError` if `size` is more than the `most` bytes that are `held`; `what`: the file that has it."""
    if size > most:
        raise RecordingError(f"{what} has {size_text(size)}, more than the {size_text(most)} that {held}.")


def _digest(archive: zipfile.ZipFile, name: str, folder: Path) -> str:
    """Return the SHA-256 of a member; the recording is unpacked into `folder` for it."""
    with open(archive.extract(name, folder), "rb") if name == RUN else archive.open(name) as data:
        return hashlib.file_digest(data, "sha256").hexdigest()
