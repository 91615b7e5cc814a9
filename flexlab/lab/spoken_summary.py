"""What the picture shows, in sentences: for people who hear the page instead of seeing it."""

from collections.abc import Callable, Sequence

import viser

from flexlab.analysis.explanations import Explained
from flexlab.lab.panel.number_control import put
from flexlab.lab.panel.readouts import SEEN_TOGETHER, largest_vibration, status_word, warnings
from flexlab.lab.panel.text import escaped, factor
from flexlab.number_text import fixed_text
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import Snapshot

EVERY = 10
"""Panel updates per summary (1 Hz)."""


class SpokenSummary:
    """The text of the picture, in the GUI container that is open while it is made; `accessibility.js` gives it to the picture."""

    def __init__(self, gui: viser.GuiApi, runner: Runner, sentences: Callable[[], Sequence[Explained]]):
        """`sentences`: what the plots show."""
        self._runner, self._sentences = runner, sentences
        self._count = 0
        self._mark = gui.add_html("")

    @property
    def text(self) -> str:
        """The sentences as they are now."""
        return summary_text(self._runner.snapshot, self._runner.recent(SEEN_TOGETHER), self._sentences())

    def update(self, _: Snapshot) -> None:
        """Bring the picture's text up to date, once a second."""
        if self._count % EVERY == 0:
            put(self._mark, content=f'<i hidden class="fl-summary" data-text="{escaped(self.text)}"></i>')
        self._count += 1


def summary_text(snapshot: Snapshot, recent: Samples, sentences: Sequence[Explained]) -> str:
    """State of the run, its numbers, what is wrong, and what the plots show; `recent` holds what is seen together."""
    scenario, sample = snapshot.scenario, snapshot.latest
    arms = f"{len(scenario.arms)} arms hold" if len(scenario.arms) > 1 else "One arm holds"
    deflection = fixed_text(1e3 * float(sample.midspan_deflection[0]), 3, signed=True)
    told = [
        f"{scenario.title or snapshot.name}: {arms} a flexible beam.",
        f"{status_word(snapshot)} at t = {fixed_text(float(sample.time[0]), 2)} s, speed {factor(snapshot.target_speed)}.",
        f"Mid-span deflection {deflection} mm, largest vibration {largest_vibration(recent)}, "
        f"first beam frequency {fixed_text(snapshot.first_frequency, 2)} Hz.",
        *warnings(snapshot),
        *(f"{each.plot}: {each.sentence}" for each in sentences),
    ]
    return " ".join(told)
