"""Serves a recording piece by piece, with its layout, by rerun's own server."""

from pathlib import Path
from tempfile import TemporaryDirectory

import rerun as rr
import rerun.blueprint as rrb
from rerun.catalog import DatasetEntry
from rerun_bindings import CatalogClientInternal

from flexlab.recording.rerun_internals.chunk_reader import quiet_reader

LOOPBACK = "127.0.0.1"
DATASET = "runs"


def serve(path: Path, application: str, layout: rrb.Blueprint) -> tuple[rr.server.Server, str]:
    """(server, to be shut down; address that a viewer opens). Raises RuntimeError, ValueError, OSError or LookupError."""
    server = rr.server.Server(host=LOOPBACK, port=0, datasets={DATASET: [path]})
    try:
        # Rerun's public client answers what follows only with a 43 MB library of queries, so its core is asked.
        (core,) = CatalogClientInternal(server.url()).datasets(False)
        _lay_out(DatasetEntry(core), application, layout)
        with quiet_reader(path) as reader:
            return server, core.segment_url(reader.recordings()[0].recording_id)
    except BaseException:
        server.shutdown()
        raise


def _lay_out(dataset: DatasetEntry, application: str, layout: rrb.Blueprint) -> None:
    """Give the served recording its layout: the server does not look for the one inside the file."""
    with TemporaryDirectory(prefix="flexlab-") as folder:
        file = Path(folder) / "layout.rbl"
        layout.save(application, file)
        dataset.register_blueprint(file.as_uri())
