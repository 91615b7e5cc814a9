"""`flexlab export [RUN]`: write a run's signals as a table, or its figures."""

from pathlib import Path
from typing import Annotated, Literal

from flexlab.cli.console import tell, typed
from flexlab.cli.options import LOGS, Logs, Run, option
from flexlab.cli.warmup import loading
from flexlab.errors import StudyError

UNIT, BODIES = ".fmu", (".urdf", ".xml", ".mjcf")
"""Files for other tools: a scenario as machine code, or as rigid bodies."""


def command(
    run: Run = "newest",
    to: Annotated[
        Path | None,
        option(
            "Table (.csv, .parquet, .npz), page with animation (.html), archive that replay verifies (.zip); "
            "for a preset: .fmu, .urdf, .xml (MuJoCo).",
            "FILE",
        ),
    ] = None,
    figures: Annotated[str | None, option("Draw the paper's Figures 2 to 5, beside FILE or here.", "PNG|SVG")] = None,
    start: Annotated[float | None, option("Leave out samples before this time, s.", "S")] = None,
    end: Annotated[float | None, option("Leave out samples after this time, s.", "S")] = None,
    part: Annotated[
        Literal["plant", "law", "loop", "follower"] | None,
        option(
            "Content of an .fmu: arms and beam, law and path, everything, or everything but the path.",
            "plant|law|loop|follower",
            default="(plant)",
        ),
    ] = None,
    fmi: Annotated[Literal[2, 3] | None, option("Version of the standard of an .fmu.", "2|3", default="(3)")] = None,
    logs: Logs = LOGS,
) -> None:
    """Write all signals of RUN as a table, or its figures, or both; or RUN as one page or one archive.

    Or write a preset or scenario file for other simulators: as a functional mock-up unit (flexlab export paper --to
    paper.fmu), or its arms and beam as rigid bodies (.urdf; .xml or .mjcf for MuJoCo).

    Column names contain the units, which are all SI. The scenario, the seed and every command are included, so that
    `flexlab import` turns a table back into the same run, bit for bit.
    """
    if to is None and figures is None:
        raise StudyError("Say what to write: --to FILE.csv (or .parquet, .npz), --figures png or svg, or both.")
    kind = "" if to is None else to.suffix.lower()
    if to is not None and kind in (UNIT, *BODIES):
        if run == "newest" or (figures, start, end) != (None, None, None):
            raise StudyError(f"{to} is made of a scenario alone: flexlab export PRESET --to {typed(to)}.")
    options = {"part": part or "plant", "version": fmi or 3} if kind == UNIT else {}
    if not options and (part, fmi) != (None, None):
        raise StudyError("--part and --fmi are for units: write --to FILE.fmu.")
    if figures is not None:
        from flexlab.analysis.figures import FORMATS

        if figures.lower() not in FORMATS:  # Before the table is written.
            raise StudyError(f"--figures {figures} is not a format of figures: choose {' or '.join(FORMATS)}.")
    if to is not None:
        with loading():
            from flexlab.recording.store.run_index import size_text
            from flexlab.study_api import export

        file = export(run, to, start, end, logs, **options)
        tell(f"{file}  {size_text(file.stat().st_size)}")
    if figures is not None:
        with loading():
            from flexlab.analysis.figures import paper_figures
            from flexlab.recording.reader import read_range
            from flexlab.recording.store.run_files import find_run

        path = find_run(run, logs)
        folder = Path() if to is None else to.parent
        tell(*paper_figures(read_range(path, start, end), folder, [figures.lower()], name=path.stem))
