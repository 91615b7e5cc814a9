"""The table of runs, for the start page and the library."""

from collections.abc import Sequence

from flexlab.door.library import RunRow, duration_text, size_text
from flexlab.door.markup import Markup, fill, join

COLUMNS = (("Started", "time"), ("Preset", "text"), ("Duration", "number"), ("Size", "number"), ("State", "text"))
ROW = """<tr>
<td data-key="{time}"><a href="/runs/{id}">{started}</a></td><td>{preset}{tags}</td>
<td data-key="{duration_key}" class="number">{duration}</td><td data-key="{size_key}" class="number">{size}</td>
<td><span class="state {kind}">{state}</span></td>{more}
</tr>"""
MORE = """<td class="metrics">{metrics}</td><td class="note">{note}</td>
<td class="row-actions"><a href="/runs/{id}.rrd" download title="Download the recording">Download</a>
<a href="/runs/{id}/delete" class="danger">Delete</a></td>"""
TABLE = """<div class="table"><table{mark}><thead><tr>{head}</tr></thead><tbody>
{rows}
</tbody></table></div>"""
METRICS_SHOWN = 4
"""Of a run's metrics, how many stand in the table."""


def runs_table(rows: Sequence[RunRow], short: bool = False) -> Markup:
    """The table; the short one has no metrics, notes and actions."""
    names = [name for name, _ in COLUMNS] + ([] if short else ["Metrics", "Note", ""])
    kinds = [kind for _, kind in COLUMNS] + ([] if short else ["text", "text", ""])
    head = join(
        fill('<th data-sort="{kind}">{name}</th>', kind=kind, name=name)
        for name, kind in zip(names, kinds, strict=True)
    )
    mark = Markup("" if short else ' id="runs"')
    return fill(TABLE, head=head, rows=join(_row(row, short) for row in rows), mark=mark)


def _row(row: RunRow, short: bool) -> Markup:
    tags = join(fill(' <span class="tag">{tag}</span>', tag=tag) for tag in row.tags)
    kept = Markup(' <span class="tag kept">kept</span>') if row.kept else Markup("")
    more = Markup("") if short else fill(MORE, id=row.id, metrics=metrics_text(row, METRICS_SHOWN), note=row.note)
    return fill(
        ROW,
        id=row.id,
        time=row.started.isoformat(),
        started=f"{row.started:%Y-%m-%d %H:%M:%S}",
        preset=row.preset,
        tags=Markup(tags + kept),
        duration_key=row.duration or 0,
        duration=duration_text(row.duration),
        size_key=row.size,
        size=size_text(row.size),
        kind=row.state.replace(" ", "-"),
        state="recording" if row.state == "in use" else row.state,
        more=more,
    )


def metrics_text(row: RunRow, most: int | None = None) -> str:
    """A run's metrics as the recording has them: name and value."""
    pairs = [(name, value) for name, value in row.metrics.items() if isinstance(value, (int, float, str))][:most]
    return ", ".join(f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in pairs)
