"""A few sentences that explain the run, beside the plots; they are found once a second and do not flicker."""

from collections.abc import Sequence

import viser

from flexlab.analysis.explanations.explanation import EXPLANATIONS, LONGEST_LOOK, Evidence, Explained, explain
from flexlab.lab.mode_computation import ModeStudy
from flexlab.lab.widgets import LAST, put
from flexlab.sim.runner import Runner
from flexlab.sim.snapshot import Snapshot
from flexlab.text import escaped

MOST = 3
"""Sentences at once."""
SEEN, MISSED = 2, 2
"""Checks in a row after which a sentence appears, and after which it disappears."""
REWORDED = 5
"""Checks for which a sentence keeps its numbers."""


class CalmList:
    """The shown sentences: one appears when it was found twice in a row, and disappears when it was missed twice."""

    def __init__(self) -> None:
        self._shown: dict[str, tuple[Explained, int, int]] = {}
        self._seen: dict[str, int] = {}

    def clear(self) -> None:
        """Forget everything: another run has begun."""
        self._shown, self._seen = {}, {}

    def look(self, found: Sequence[Explained]) -> list[Explained]:
        """The sentences to show after a check that found these, the most important first."""
        now = {each.name: each for each in found}
        self._seen = {name: self._seen.get(name, 0) + 1 for name in now}
        for name in list(self._shown):
            text, missed, age = self._shown[name]
            if name in now:
                fresh = age + 1 >= REWORDED
                self._shown[name] = (now[name] if fresh else text, 0, 0 if fresh else age + 1)
            elif missed + 1 >= MISSED:
                del self._shown[name]
            else:
                self._shown[name] = (text, missed + 1, age)
        for name, each in now.items():
            if name not in self._shown and self._seen[name] >= SEEN:
                self._shown[name] = (each, 0, 0)
        return [self._shown[name][0] for name in EXPLANATIONS if name in self._shown][:MOST]


class ExplanationList:
    """The sentences, the same on every tab of the plots."""

    def __init__(self, gui: viser.GuiApi, runner: Runner, study: ModeStudy, tabs: Sequence[viser.GuiTabHandle]):
        self._runner, self._study = runner, study
        self._calm = CalmList()
        self.sentences: Sequence[Explained] = ()
        """The sentences that are shown."""
        self._run_number, self._time = -1, -1.0
        self._places = []
        for tab in tabs:
            with tab:
                self._places.append(gui.add_html("", order=LAST, visible=False))

    def update(self, snapshot: Snapshot) -> None:
        """Check again while the run plays; to be called once a second."""
        if snapshot.run_number != self._run_number:
            self._run_number = snapshot.run_number
            self._calm.clear()
            self._show([])
        now = float(snapshot.latest.time[0])
        if now != self._time:
            self._time = now
            self._show(self._calm.look(self._found(snapshot)))

    def _found(self, snapshot: Snapshot) -> Sequence[Explained]:
        background = self._study.background(snapshot.scenario)
        if background is None:
            return ()
        recent = self._runner.recent(LONGEST_LOOK)
        return explain(Evidence.of_run(recent, background, snapshot.start_time, snapshot.events))

    def _show(self, sentences: Sequence[Explained]) -> None:
        self.sentences = sentences
        text = list_html(sentences)
        for place in self._places:
            put(place, content=text, visible=bool(text))


def list_html(sentences: Sequence[Explained]) -> str:
    """Each sentence with the plot that shows it, and its equation."""
    items = "".join(
        f'<div class="fl-why"><b>{escaped(each.plot)}.</b> {escaped(each.sentence)} '
        f'<span class="fl-dim">{escaped(each.equation)}</span></div>'
        for each in sentences
    )
    return f'<div class="fl"><h2 class="fl-title">What the plots show</h2>{items}</div>' if items else ""
