"""Comparison of a kept run with the present one: a table of metrics and a list of changed settings."""

import math
import threading

import viser

from flexlab.analysis.metrics import MetricRow
from flexlab.errors import FlexlabError
from flexlab.lab.reference_run import LONGEST, Recorded, ReferenceRun, common_metrics, keep_run, whole_run
from flexlab.lab.widgets import Widgets, put, table_html
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import differences, field_title, told, value_text
from flexlab.sim.runner import Runner
from flexlab.sim.snapshot import Snapshot
from flexlab.text import escaped, number_text, with_units

MOST_CHANGES = 12
AS_FACTOR = 1000.0
"""Change in per cent from which on a factor is easier to read."""


class Comparing:
    """Buttons and table, made in the open GUI container."""

    def __init__(self, widgets: Widgets):
        self._lab_state = widgets.lab_state
        words = (
            "Keep this run, change a setting or the control law, and press Reset: the kept run stays behind the new one, "
            "its beam in grey and its curves dotted."
        )
        widgets.gui.add_html(f'<div class="fl fl-dim">{words}</div>')
        ghost, hint = viser.Icon.GHOST_2, "Remove the kept run from the screen"
        widgets.button("Keep this run", lambda _: self._keep(), icon=ghost, hint="As it was computed")
        self._forgets = widgets.button("Forget it", lambda _: self._forget(), hint=hint, visible=False)
        self._table = widgets.gui.add_html("")

    def _keep(self) -> None:
        kept, start = keep_run(self._lab_state.runner), self._lab_state.snapshot.start_time
        self._lab_state.kept = kept
        self._say_kept(kept)
        self.update(self._lab_state.snapshot)
        recorded = self._lab_state.outside.recorded
        if recorded is not None and kept.span[0] > start:
            # On a thread: reading a minute takes a second or two, and the page must go on answering.
            given = kept, start, recorded
            threading.Thread(target=self._complete, args=given, name="flexlab-keep", daemon=True).start()

    def _complete(self, kept: ReferenceRun, start: float, recorded: Recorded) -> None:
        """Also keep the beginning of a run, read from its recording."""
        try:
            whole = whole_run(kept, start, recorded)
        except FlexlabError as error:
            self._lab_state.warn(f"Only the last {LONGEST:g} s are kept. {error}")
            return
        if self._lab_state.kept is kept:
            self._lab_state.kept = whole
            self._say_kept(whole)

    def _say_kept(self, kept: ReferenceRun) -> None:
        first, last = kept.span
        self._lab_state.say(
            f"Kept {kept.name} from t = {first:.1f} to {last:.1f} s: change something, then press Reset."
        )

    def _forget(self) -> None:
        self._lab_state.kept = None
        self.update(self._lab_state.snapshot)

    def update(self, snapshot: Snapshot) -> None:
        """Update the table; call once a second, as its metrics read the whole common time."""
        kept = self._lab_state.kept
        put(self._forgets, visible=kept is not None)
        self._table.content = "" if kept is None else comparison_html(kept, snapshot, self._lab_state.runner)


def comparison_html(kept: ReferenceRun, snapshot: Snapshot, runner: Runner) -> str:
    """The table of metrics over the common time, and the settings that differ."""
    rows, (first, last) = common_metrics(kept, runner.recent(LONGEST))
    settings = changes_table(kept.scenario, snapshot.scenario, "setting", "kept", "now")
    settings = settings or "<div>Both runs have the same settings.</div>"
    if not rows:
        low, high = kept.span
        text = f"The kept run has t = {low:.2f} s to {high:.2f} s; the present one does not overlap it yet."
        return f'<div class="fl">{text}{settings}</div>'
    lines = []
    for old, new in rows[1:]:
        if not (old.applies or new.applies):
            continue
        shown = change_text(100 * (new.value / old.value - 1) if old.value else math.nan).replace(
            " ", "\N{NO-BREAK SPACE}"
        )
        lines.append((escaped(with_units(old.label)), metric_text(old), metric_text(new), shown))
    table = table_html(lines, "", "kept", "now", "change", numbers=(1, 2, 3))
    return f'<div class="fl">Over t = {first:.2f} s to {last:.2f} s of both runs:{table}{settings}</div>'


def metric_text(row: MetricRow) -> str:
    """A metric with three digits, or its text for a missing value, as HTML."""
    return escaped(row.column.missing) if math.isnan(row.value) else number_text(row.value, 3)


def change_text(percent: float) -> str:
    """A change in whole per cent with its sign, or as a factor; "–" if there is nothing to compare with."""
    if not math.isfinite(percent):
        return "–"
    if percent >= AS_FACTOR:
        return f"{number_text(1 + percent / 100, 2)} ×"
    return f"{percent:+.0f} %".replace("-", "−") if round(percent) else "0 %"


def changes_table(before: Scenario, now: Scenario, *heads: str) -> str:
    """The differences of `now` from `before` as an HTML table with three heads; empty if there are none."""
    changed = told_html(before, now)
    if not changed:
        return ""
    more = len(changed) - MOST_CHANGES
    note = f"<div>… and {more} more.</div>" if more > 0 else ""
    return table_html(changed[:MOST_CHANGES], *heads, numbers=(1, 2)) + note


def told_html(before: Scenario, now: Scenario) -> list[tuple[str, str, str]]:
    """(title, value in `before`, value in `now`) of every field that differs, as HTML."""
    return [
        (escaped(field_title(path, now, before)), escaped(value_text(old)), escaped(value_text(new)))
        for path, old, new in told(differences(before, now))
    ]
