"""What an explanation is: a function that looks at the evidence and gives a sentence, or none where its check fails.

To add one, copy one of `forces.py` into a file of its own: lab, command line and Python interface show it, and
`tests/analysis/test_explanations.py` asks for a scripted case. A sentence states what was measured or computed here, and only
if measurement and equation agree (or, of poles and margins, if the equation alone decides).
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexlab.analysis.explanations.evidence import Background, Evidence
from flexlab.errors import FlexlabError
from flexlab.text import fixed_text, number_text

if TYPE_CHECKING:
    from flexlab.sim.samples import Run

Look = Callable[[Evidence], str | None]
"""The sentence that the evidence bears out; None: nothing to say."""


@dataclass(frozen=True)
class Explanation:
    """One kind of sentence."""

    name: str
    equation: str
    """What connects cause and effect, with its number in the paper where it has one."""
    plot: str
    """The title, or the beginning of titles, of the plots in the lab on which it is seen."""
    place: int
    """Rank: smaller ones are more important."""
    look: Look


@dataclass(frozen=True)
class Explained:
    """A sentence about a run, with the equation behind it and the plot that shows it."""

    name: str
    sentence: str
    equation: str
    plot: str

    def __str__(self) -> str:
        return f"{self.sentence} [{self.plot}; {self.equation}]"


EXPLANATIONS: dict[str, Explanation] = {}
"""Every explanation by its name, the most important first."""


NOTHING = 1e-9
"""Below this a number of a sentence, in the units that people read, is rounding."""


def n(value: float) -> str:
    """A number in a sentence: three digits, or all that stand before the point."""
    if abs(value) < NOTHING:
        return "0"
    return number_text(value, 3) if abs(value) < 1000 else fixed_text(value, 0)


def register(name: str, equation: str, plot: str, place: int) -> Callable[[Look], Look]:
    """Function decorator: adds an explanation to `EXPLANATIONS`. Raises ValueError for a name that is taken."""

    def add(look: Look) -> Look:
        if name in EXPLANATIONS:
            raise ValueError(f"two explanations are called {name!r}")
        EXPLANATIONS[name] = Explanation(name, equation, plot, place, look)
        ordered = sorted(EXPLANATIONS.items(), key=lambda item: item[1].place)
        EXPLANATIONS.clear()
        EXPLANATIONS.update(ordered)
        return look

    return add


def explain(evidence: Evidence) -> tuple[Explained, ...]:
    """All that the evidence bears out, the most important first."""
    if len(evidence.samples) < 2 or not np.isfinite(evidence.samples.vibration).all():
        return ()
    found = ((each, each.look(evidence)) for each in EXPLANATIONS.values())
    # A signal that an old recording lacks reads as NaN: nothing was measured, so nothing is said.
    said = ((each, text) for each, text in found if text is not None and not re.search(r"\bnan\b", text))
    return tuple(Explained(each.name, text, each.equation, each.plot) for each, text in said)


def explain_run(run: "Run") -> tuple[Explained, ...]:
    """What can be said of a run's newest `LONGEST_LOOK` s, as if nothing had changed since its first sample's scenario.

    Nothing of one whose scenario has no modes, as where an arm cannot reach: the run's status says why.
    """
    try:
        background = Background.of(run.scenario)
    except FlexlabError:
        return ()
    return explain(Evidence.of_run(run, background))
