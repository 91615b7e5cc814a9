"""The report of a validation: one HTML file with figures that opens without network."""

import platform
from datetime import datetime
from pathlib import Path

from markupsafe import Markup

from flexlab.analysis.figures import FIGURES, draw_figure, svg_text
from flexlab.analysis.validation.check import Validation
from flexlab.errors import FlexlabError
from flexlab.files import filled, make_folder, write_text
from flexlab.recording.run_info import these_versions

TITLES = {2: "Trajectory of the payload", 3: "Vibration", 4: "Error of the trajectory", 5: "Internal force"}
SHOWN = 3.0
"""Time that the figures show, as in the paper, s."""


def write_report(validation: Validation, path: Path, seconds: float) -> None:
    """Write the report; `seconds`: duration of the validation. Raises `StudyError`."""
    text = filled(
        Path(__file__).with_name("report.html"),
        groups=validation.groups,
        failed=[check for check in validation.checks if not check.holds],
        count=len(validation.checks),
        figures=_figures(validation),
        versions=these_versions(),
        machine=f"{platform.machine()}, {platform.system()}",
        made=f"{datetime.now():%Y-%m-%d %H:%M}",
        seconds=seconds,
    )
    make_folder(path.parent, "choose another file")
    write_text(path, text)


def _figures(validation: Validation) -> list[tuple[int, str, Markup]]:
    """(number, title, SVG) of the paper's figures; none if the run fails."""
    try:
        run = validation.runs.paper
    except FlexlabError:
        return []
    samples = run.take(run.time <= SHOWN)
    return [
        (number, TITLES[number], Markup(svg_text(draw_figure(number, samples), f"flexlab-{number}")))
        for number in FIGURES
    ]
