"""The table of runs, for the start page and the library."""

from collections.abc import Sequence

from flexlab.analysis.metrics import METRICS
from flexlab.analysis.metrics.noted import noted_text, noted_value
from flexlab.recording.store.run_index import RunRow, duration_text, size_text, state_word
from flexlab.server.pages.markup import Markup, fill, join

COLUMNS = (("Started", "time"), ("Preset", "text"), ("Duration", "number"), ("Size", "number"), ("State", "text"))
METRIC_COLUMNS = [column for metric in METRICS.values() for column in metric.columns if column.listed]
"""Those of which a table has room; a run's own page has all."""

ROW = """<tr>{choose}
<td data-key="{time}"><a href="/runs/{place}">{started}</a></td><td>{preset}{tags}</td>
<td data-key="{duration_key}" class="number">{duration}</td><td data-key="{size_key}" class="number">{size}</td>
<td><span class="state {kind}" title="{problem}">{state}</span></td>{more}
</tr>"""
CHOOSE = """<td class="choose"><label><input type="checkbox" name="run" value="{id}" form="compare"
aria-label="Compare {preset} of {started}"></label></td>"""
MORE = """{metrics}<td class="note">{note}<span class="changes">{changes}</span></td>
<td class="row-actions"><a href="/runs/{place}/delete" class="danger">Delete</a></td>"""
METRIC = """<td data-key="{key}" class="number">{text}</td>"""
TABLE = """<div class="table"><table{mark}><thead><tr>{choice}{head}</tr></thead><tbody>
{rows}
</tbody></table></div>"""
CHANGES_SHOWN = 3
"""Of what was changed in a run, how many lines stand in the table."""


def runs_table(rows: Sequence[RunRow], short: bool = False) -> Markup:
    """The table; the short one has no metrics, notes and actions."""
    columns = [(name, "", kind, name) for name, kind in COLUMNS]
    if not short:
        columns += [(_capital(c.heading), f"[{c.unit}]", "number", c.key) for c in METRIC_COLUMNS]
        columns += [
            ("Note, changes", "", "text", "Note, and what was changed against the preset"),
            ("", "", "text", ""),
        ]
    heading = '<th data-sort="{kind}" title="{title}">{name} <small>{unit}</small></th>'
    choice = Markup("" if short else '<th class="choose"><span class="unseen">Compare</span></th>')
    head = join(fill(heading, name=name, unit=unit, kind=kind, title=title) for name, unit, kind, title in columns)
    mark = Markup("" if short else ' id="runs"')
    return fill(TABLE, choice=choice, head=head, rows=join(_row(row, short) for row in rows), mark=mark)


def _row(row: RunRow, short: bool) -> Markup:
    tags = join(fill(' <span class="tag">{tag}</span>', tag=tag) for tag in row.tags)
    kept = Markup(' <span class="tag kept">kept</span>') if row.kept else Markup("")
    return fill(
        ROW,
        choose=Markup("")
        if short
        else fill(CHOOSE, id=row.id, preset=row.preset, started=f"{row.started:%d %b %H:%M:%S}"),
        place=row.address,
        problem=row.problem,
        time=row.started.isoformat(),
        started=f"{row.started:%Y-%m-%d %H:%M:%S}",
        preset=row.preset,
        tags=Markup(tags + kept),
        duration_key=row.duration or 0,
        duration=duration_text(row.duration),
        size_key=row.size,
        size=size_text(row.size),
        kind=row.state.replace(" ", "-"),
        state=state_word(row),
        more=Markup("") if short else _more(row),
    )


def _more(row: RunRow) -> Markup:
    metrics = join(
        fill(METRIC, key=noted_value(column, row.metrics), text=noted_text(column, row.metrics))
        for column in METRIC_COLUMNS
    )
    left = len(row.changes) - CHANGES_SHOWN
    changes = "; ".join(row.changes[:CHANGES_SHOWN]) + (f"; {left} more" if left > 0 else "")
    said = " ".join(filter(None, (row.problem, row.note)))
    return fill(MORE, place=row.address, metrics=metrics, note=f"{said} " if said else "", changes=changes)


def _capital(heading: str) -> str:
    return heading[0].upper() + heading[1:]
