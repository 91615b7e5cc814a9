"""What the panel says about the run: time, speed, status and events as HTML, and a spoken summary."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import viser

from flexlab.analysis.explanations.explanation import Explained, is_pulled
from flexlab.control.conditions import Condition
from flexlab.guide import LOCKED, ClassRules
from flexlab.lab.lab_state import Notice
from flexlab.lab.look_back import LookBack
from flexlab.lab.view_settings import ViewSettings
from flexlab.lab.widgets import put
from flexlab.physics.beam import free_coordinates
from flexlab.scenario import Payload
from flexlab.scenario.field_text import change_in_words
from flexlab.sim.commands import Pull
from flexlab.sim.run_warnings import CURE, Largest, Peaks, model_warning
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import TICK, Event, Snapshot
from flexlab.text import escaped, fixed_text, number_text, speed_text, with_indices, with_units
from flexlab.views import GREEN, ORANGE, SKY, css

CLEARLY_SLOWER = 0.95
"""Fraction of the wanted speed below which being too slow gets a sentence, not just a word."""
SHOWN_EVENTS = 40
HELD, UNPRESSED = "grips held", "no axial force"
"""What the first frequency is of: a beam that is pressed rings more slowly, one that is pulled or spun faster."""
SEEN_TOGETHER = 1.0
"""Time over which the largest vibration is taken, simulated s."""
LASTING = round(0.25 / TICK)
"""Samples within that time after which a load on the beam does not count as momentary."""
SMALLEST_IN_MM = 0.1
"""Smallest vibration that is given in mm; smaller ones are in µm."""


def status_html(snapshot: Snapshot, view: ViewSettings, scales: Sequence[tuple[str, str]], recording: str) -> str:
    """The head of the panel; `recording`: where the run is recorded, or empty."""
    sample = snapshot.latest
    tone, word = _status(snapshot)
    bending = 1e3 * float(sample.midspan_deflection[0])
    limit = ' <span class="fl-bad">at its limit</span>' if sample.saturated[0] else ""
    wanted, measured = snapshot.target_speed, snapshot.actual_speed
    speed = f"{speed_text(wanted)} / {_measured(measured)}"
    too_slow = snapshot.too_slow and _measured(measured) != _measured(wanted)
    if snapshot.steps_left:
        goal = float(sample.time[0]) + snapshot.steps_left * TICK
        speed = f"as fast as possible, to t = {number_text(goal, 6)} s"
    rows = [
        ("simulation time t", f"{fixed_text(float(sample.time[0]), 3)} s"),
        ("speed, wanted / actual", f'<span class="fl-bad">too slow:</span> {speed}' if too_slow else speed),
        (
            f"first beam frequency f<sub>1</sub>, {UNPRESSED if _feels_axial_force(snapshot) else HELD}",
            f"{fixed_text(snapshot.first_frequency, 2)} Hz",
        ),
        ("mid-span deflection", f"{fixed_text(bending, 3, signed=True)} mm"),
        ("largest joint torque", f"{fixed_text(float(np.abs(sample.joint_torque[0]).max()), 1)} N·m{limit}"),
        ("drawn deflection", f"{number_text(view.exaggeration)} × true size"),
        *scales,
    ]
    if snapshot.dropped_samples:
        rows.append(("samples not recorded", f'<span class="fl-bad">{snapshot.dropped_samples}</span>'))
    grid = "".join(f"<div><span>{name}</span><span>{value}</span></div>" for name, value in rows)
    dot = f'<span class="fl-dot" style="background:{tone}"></span>'
    kept = f'<div class="fl-dim fl-line">{escaped(with_units(recording))}</div>' if recording else ""
    return f'<div class="fl"><h2 class="fl-title">{dot}{word}</h2><div class="fl-grid">{grid}</div>{kept}</div>'


def _feels_axial_force(snapshot: Snapshot) -> bool:
    return snapshot.scenario.payload.axial_load != "none"


def number_html(recent: Samples, snapshot: Snapshot) -> str:
    """The run's main numbers in large type, for a presentation; `recent`: the samples over which the vibration is taken."""
    shown = largest_vibration(recent, snapshot.events)
    first = f"f<sub>1</sub> = {fixed_text(snapshot.first_frequency, 1)} Hz"
    kind = f"<span>{UNPRESSED}</span>" if _feels_axial_force(snapshot) else ""
    return f'<div class="fl fl-number"><span>largest vibration</span><b>{shown}</b><span>{first}</span>{kind}</div>'


def largest_vibration(recent: Samples, events: Sequence[Event]) -> str:
    """The largest vibration of some samples, with its unit; measured from its middle while somebody pulls the beam."""
    signal = recent.vibration
    if len(recent) and is_pulled(events, float(recent.time[0])):
        signal = signal - 0.5 * (signal.max() + signal.min())
    vibration = 1e3 * float(np.abs(signal).max()) if len(recent) else 0.0
    return f"{fixed_text(vibration, 2)} mm" if vibration >= SMALLEST_IN_MM else f"{fixed_text(1e3 * vibration, 1)} µm"


def _measured(speed: float) -> str:
    """A measured speed, to a hundredth or, in slow motion, to two digits."""
    return f"{fixed_text(speed, 2)} ×" if speed >= 0.1 or speed == 0 else f"{number_text(speed, 2)} ×"


def notices_html(snapshot: Snapshot, recent: Samples, notice: Notice, rules: ClassRules) -> str:
    """Warnings and notices that float over the picture, so that nothing in the panel moves; empty if there are none.

    `recent`: as in `number_html`.

    Sentences about the teacher's `rules` stay as long as the rules hold.
    """
    locked = LOCKED if rules.locked and notice.text != LOCKED else ""
    standing = {"fl-pace": rules.pace, "fl-pace-on-play": rules.pace_on_play_screen, "": locked}
    boxes = [_box(text, "info", kind) for kind, text in standing.items() if text]
    cautions = _cautions(snapshot, recent)
    boxes += [_box(text, "error", "fl-caution" if text in cautions else "") for text in warnings(snapshot, recent)]
    if notice.text and not (snapshot.status.failed and notice.text == snapshot.status.text):
        boxes.append(_box(notice.text, notice.level))
    return f'<div class="fl fl-float">{"".join(boxes)}</div>' if boxes else ""


def _status(snapshot: Snapshot) -> tuple[str, str]:
    """Colour of the dot, and the status in words."""
    if snapshot.status.failed:
        return "#e03131", "Stopped"
    if snapshot.playing and snapshot.waiting:
        return css(SKY), "Begins when the page is drawn"
    if snapshot.moves:
        return css(GREEN), "Running"
    return css(ORANGE), "Paused"


def warnings(snapshot: Snapshot, recent: Samples) -> list[str]:
    """The present warnings about the run, one sentence each; `recent`: as in `number_html`."""
    found = [snapshot.status.text] if snapshot.status.failed else []
    found += _cautions(snapshot, recent)
    if snapshot.pace_warning:
        found.append(snapshot.pace_warning)
    elif snapshot.too_slow and snapshot.actual_speed < CLEARLY_SLOWER * snapshot.target_speed:
        found.append(
            f"Too slow: this machine reaches {_measured(snapshot.actual_speed)} instead of {speed_text(snapshot.target_speed)}. "
            "Choose a lower speed or fewer elements."
        )
    return found


def _cautions(snapshot: Snapshot, recent: Samples) -> list[str]:
    """Warnings about the accuracy of numbers; the play screen, which has no numbers, hides them.

    What the beam's model neglects is told while it lasts, and then left to the events and explanations. Why a run stopped
    tells more than that its numbers were no longer accurate.
    """
    of_model, of_results = snapshot.model_warning, snapshot.accuracy_warning
    if snapshot.status.failed:
        of_results = ""
    elif of_model and not _lasts(snapshot.scenario.payload, recent):
        of_model = ""
    of_model = of_model.replace(f"{CURE} ", "", of_model.count(CURE) - 1)  # One advice for all that it tells.
    return [text for text in (of_results, of_model) if text]


def _lasts(payload: Payload, recent: Samples) -> bool:
    """Whether the last second has bent the beam too far, or pressed or spun it not only for moments, as a jerk does."""
    nodes = free_coordinates(payload.element_count, payload.boundary) % 2 == 0
    bent = [recent.midspan_deflection]
    if recent.beam_coordinates.shape[1] == len(nodes):
        bent.append(recent.beam_coordinates[:, nodes].ravel())
    bending = Largest(float(np.abs(np.concatenate(bent)).max(initial=0.0)) / payload.length)
    shares = (recent.axial_load_share, recent.spin_share) if len(recent) >= LASTING else ()
    load, spin = (Largest(float(np.sort(share)[-LASTING])) for share in shares) if shares else (Largest(), Largest())
    return bool(model_warning(payload, Peaks(load_share=load, spin_share=spin, bending=bending)).text)


def _box(text: str, level: str, kind: str = "") -> str:
    kinds = " ".join(filter(None, ("fl-box", "fl-error" if level == "error" else "fl-info", kind)))
    return f'<div class="{kinds}">{escaped(with_units(text))}</div>'


def events_html(snapshot: Snapshot) -> str:
    """The newest events first, with their simulation times."""
    lines = []
    for event in reversed(_without_drags(snapshot.events)[-SHOWN_EVENTS:]):
        bad = ' class="fl-bad"' if event.level != "info" else ""
        time, told = f"{fixed_text(event.time, 3)} s", with_units(change_in_words(event.text))
        lines.append(f'<div><span class="fl-dim">{time}</span> <span{bad}>{escaped(told)}</span></div>')
    shown = "".join(lines) or "Nothing yet. Changes, taps, pulls and warnings appear here."
    return f'<div class="fl fl-list" tabindex="0">{shown}</div>'


def conditions_html(conditions: Iterable[Condition]) -> str:
    """The conditions of the control law, each with its numbers, met or not."""
    lines = []
    for condition in conditions:
        kind, word = ("fl-dim", "met") if condition.met else ("fl-bad", "not met")
        lines.append(
            f'<div class="fl-line {kind}"><b>{word}</b> {escaped(with_units(with_indices(condition.sentence)))}</div>'
        )
    return f'<div class="fl">{"".join(lines)}</div>' if lines else ""


def _without_drags(events: tuple[Event, ...]) -> list[Event]:
    """The events with each series of pulls, as from one drag, reduced to its last one."""
    kept: list[Event] = []
    for event in events:
        dragging = isinstance(event.command, Pull) and event.command.stiffness > 0
        if dragging and kept and isinstance(kept[-1].command, Pull) and kept[-1].command.stiffness > 0:
            kept.pop()
        kept.append(event)
    return kept


class SpokenSummary:
    """The text alternative of the picture, made in the open GUI container; `accessibility.js` attaches it to the picture."""

    def __init__(
        self, gui: viser.GuiApi, runner: Runner, look_back: LookBack, sentences: Callable[[], Sequence[Explained]]
    ):
        """`sentences` returns the explanations that the plots show."""
        self._runner, self._look_back, self._sentences = runner, look_back, sentences
        self._mark = gui.add_html("")

    @property
    def text(self) -> str:
        """The present text."""
        seen = self._look_back.seen(self._runner.snapshot)
        return summary_text(seen, self._look_back.recent(SEEN_TOGETHER), self._sentences())

    def update(self, _: Snapshot) -> None:
        """Update the picture's text."""
        put(self._mark, content=f'<i hidden class="fl-summary" data-text="{escaped(self.text)}"></i>')


def summary_text(snapshot: Snapshot, recent: Samples, sentences: Sequence[Explained]) -> str:
    """State, numbers and warnings of the run, and what the plots show; `recent` as in `number_html`."""
    scenario, sample = snapshot.scenario, snapshot.latest
    arms = f"{len(scenario.arms)} arms hold" if len(scenario.arms) > 1 else "One arm holds"
    deflection = fixed_text(1e3 * float(sample.midspan_deflection[0]), 3, signed=True)
    kind = f", {UNPRESSED}" if _feels_axial_force(snapshot) else ""
    told = [
        f"{scenario.title or snapshot.name}: {arms} a flexible beam.",
        f"{_status(snapshot)[1]} at t = {fixed_text(float(sample.time[0]), 2)} s, speed {speed_text(snapshot.target_speed)}.",
        f"Mid-span deflection {deflection} mm, largest vibration {largest_vibration(recent, snapshot.events)}, "
        f"first beam frequency {fixed_text(snapshot.first_frequency, 2)} Hz{kind}.",
        *warnings(snapshot, recent),
        *(f"{each.plot}: {each.sentence}" for each in sentences),
    ]
    return " ".join(told)
