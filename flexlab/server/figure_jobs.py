"""A run's figures, drawn in a process of its own; apart from other work, which need not wait for a library of drawing."""

import zipfile
from pathlib import Path

from flexlab.analysis.figures import paper_figures
from flexlab.recording.reader import read_range
from flexlab.server.run_jobs import check_size, range_name


def figures_into(path: Path, kind: str, start: float | None, end: float | None, folder: Path) -> Path:
    """Draw Figures 2-5 of a run, or of a range of its time, into one file in `folder`. `kind`: png or svg."""
    name = range_name(path, start, end)
    if start is None and end is None:
        check_size(path)
    target = folder / f"{name}-figures-{kind}.zip"
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for figure in paper_figures(read_range(path, start, end), folder, [kind], name=name):
            archive.write(figure, figure.name)
    return target
