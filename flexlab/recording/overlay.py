"""Comparisons: two or more runs in one rerun file, with overlaid curves and time from each run's first sample."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from flexlab.errors import RecordingError
from flexlab.files import replacing
from flexlab.recording.codec import larger_blocks
from flexlab.recording.reader import Recording
from flexlab.recording.rerun_internals.chunks import new_stream, quiet_reader, send_columns, send_layout, time_column
from flexlab.recording.rerun_internals.rrd_file import messages
from flexlab.recording.rerun_internals.tool import Mending
from flexlab.recording.run_encoder import curves, shown_columns
from flexlab.recording.scene_and_plots import (
    FRAMES_PER_SECOND,
    MAIN_PLOTS,
    fixed_shapes,
    plot_view,
    scene_view,
    side_by_side,
)
from flexlab.sim.samples import MEASURED, Samples
from flexlab.text import number_text
from flexlab.views import View, fitting_exaggeration, views

APPLICATION = "flexlab comparison"
"""Different from that of single runs, whose layout a person may have changed."""
MOST_RUNS = 6
"""Largest number of runs: curves of more cannot be distinguished."""
SCENES_SHAPE = 1.2
"""Assumed width over height of all scenes together: less than the true one, even beside tables, so that no elbow is cut off."""
BLOCK_ROWS = 4000
"""Samples sent at once."""


def write_comparison(
    recordings: Sequence[Recording], target: Path, text: str = "", seen: Callable[[int], None] = lambda samples: None
) -> None:
    """Write 2 to `MOST_RUNS` runs into the rerun file `target`, with a layout that overlays them.

    `text`: markdown shown beside the plots, such as a table of differences. `seen` is called with the number of samples in
    each piece that was written. Raises `RecordingError`, also for a target that is another file than a comparison.
    """
    if target.exists() and not (target.is_file() and is_comparison(target)):
        raise RecordingError(f"{target} exists already and is no comparison: give another name, as it would be lost.")
    if not 2 <= len(recordings) <= MOST_RUNS:
        raise RecordingError(f"Choose 2 to {MOST_RUNS} runs to compare, not {len(recordings)}.")
    stream = new_stream(APPLICATION)
    try:
        encoded = stream.binary_stream()
        stream.set_sinks(encoded)
        # Active, not only the default: a busy viewer makes a layout of its own for the first pieces, and keeps that.
        send_layout(stream, comparison_blueprint(recordings))
        stream.send_recording_name(" and ".join(f"{run.name} {run.started:%H:%M:%S}" for run in recordings))
        stream.log("differences", rr.TextDocument(text, media_type="text/markdown"), static=True)
        with replacing(target) as draft:
            _write(stream, encoded, recordings, draft, seen)
    except (RuntimeError, OSError) as error:
        reason = (error.strerror if isinstance(error, OSError) else "") or str(error).split("\n")[0]
        raise RecordingError(
            f"The comparison cannot be written to {target} ({reason}): choose another place."
        ) from None
    finally:
        stream.disconnect()


def is_comparison(path: Path) -> bool:
    """Whether a file was written by `write_comparison`."""
    try:
        with quiet_reader(path) as reader:
            return any(entry.application_id == APPLICATION for entry in reader.recordings())
    except (RuntimeError, ValueError, OSError):
        return False


def _write(
    stream: rr.RecordingStream,
    encoded: rr.BinaryStream,
    recordings: Sequence[Recording],
    draft: Path,
    seen: Callable[[int], None],
) -> None:
    """Write piece by piece, which needs little memory, then add an index, so that the file opens fast."""
    factor = _factor(recordings)
    pieces = draft.with_suffix(".pieces")
    try:
        with pieces.open("wb") as file:
            for number, recording in enumerate(recordings):
                for samples in _send_run(stream, number, recording, factor):
                    if piece := encoded.read():
                        file.write(messages(piece, with_head=file.tell() == 0))
                    seen(samples)
        if not Mending().rewrite(pieces, draft):
            raise RuntimeError("rerun's tool fails")
    finally:
        pieces.unlink(missing_ok=True)


def run_label(number: int) -> str:
    """A, B, C…: a run's name in curves and tables."""
    return chr(ord("A") + number)


def _factor(recordings: Sequence[Recording]) -> float:
    """One exaggeration of the drawn deflection for all runs, so that they can be compared by eye."""
    return min(fitting_exaggeration(recording.scenario) for recording in recordings)


def _send_run(stream: rr.RecordingStream, number: int, recording: Recording, factor: float) -> Iterator[int]:
    """Send a run; yield the number of samples of each piece after sending it, so that it can be written."""
    scenario, label = recording.scenario, run_label(number)
    signals = views(scenario)
    for signal in signals:
        names = [f"{label}: {name}" for name in signal.names]
        colors = [_shade(color, number) for color in signal.colors]
        stream.log(f"runs/{label}/{signal.entity}", curves(names, colors), static=True)
    for entity, shape in fixed_shapes(scenario) if recording.status != MEASURED else ():
        stream.log(f"runs/{label}/{entity}", shape, static=True)
    stream.flush()
    yield 0
    stride = max(1, round(1 / (FRAMES_PER_SECOND * recording.sample_period)))
    for block in _from_zero(larger_blocks(recording.blocks(), BLOCK_ROWS)):
        drawn = block.take(slice(None, None, stride))
        for entity, time, columns in shown_columns(scenario, signals, block, drawn, factor):
            send_columns(stream, f"runs/{label}/{entity}", time_column(time), columns)
        yield len(block.time)


def _from_zero(blocks: Iterable[Samples]) -> Iterator[Samples]:
    """The blocks with time counted from the first sample."""
    first = None
    for block in blocks:
        first = block.time[0] if first is None else first
        yield block.having(time=block.time - first)


def _shade(color: tuple[int, int, int], number: int) -> tuple[int, int, int]:
    """The colour of a curve, paler for later runs."""
    pale = 1 - 0.55**number
    red, green, blue = (round(part + pale * (235 - part)) for part in color)
    return red, green, blue


def comparison_blueprint(recordings: Sequence[Recording]) -> rrb.Blueprint:
    """The layout of a comparison of these runs; measured ones have no drawing."""
    labels = [run_label(number) for number in range(len(recordings))]
    scenarios = sorted((recording.scenario for recording in recordings), key=lambda scenario: len(scenario.arms))
    signals = {signal.entity: signal for scenario in scenarios for signal in views(scenario)}
    rest = [_overlay(signal, labels) for name, signal in signals.items() if name not in MAIN_PLOTS]
    left: rrb.Container = rrb.Tabs(rrb.TextDocumentView(origin="differences", name="Differences"), *rest, active_tab=0)
    if scenes := _scenes(recordings):
        # New ones each time: rerun drops a layout that has a view twice.
        beside = rrb.Horizontal(*_scenes(recordings), name="Side by side")
        left = rrb.Vertical(rrb.Tabs(beside, *scenes, active_tab=0), left)
    right = rrb.Vertical(*(_overlay(signals[name], labels) for name in MAIN_PLOTS))
    return side_by_side(left, right)


def _scenes(recordings: Sequence[Recording]) -> list[rrb.View]:
    """A drawing of each run that was not measured."""
    factor = number_text(_factor(recordings))
    drawn = [(run_label(number), run) for number, run in enumerate(recordings) if run.status != MEASURED]
    return [
        scene_view(
            f"{label}: {run.name}, deflection drawn × {factor}",
            run.scenario,
            f"/runs/{label}/scene/**",
            SCENES_SHAPE / len(drawn),
        )
        for label, run in drawn
    ]


def _overlay(signal: View, labels: Sequence[str]) -> rrb.TimeSeriesView:
    return plot_view(signal, [f"/runs/{label}/{signal.entity}" for label in labels])
