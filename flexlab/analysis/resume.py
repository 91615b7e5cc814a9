"""Goes on from an instant of a recorded run, in a lab: with its exact state, and with its time."""

from dataclasses import replace

from flexlab.analysis.replay import recording_span, state_at
from flexlab.errors import StudyError
from flexlab.recording.reader import Recording
from flexlab.scenario import Scenario
from flexlab.sim.snapshot import TICK
from flexlab.sim.world_state import Origin

MILLI = 1e3


def resume(
    recording: Recording, time: float | None = None, span: tuple[float, float] | None = None
) -> tuple[Scenario, Origin]:
    """Scenario and origin for a lab that goes on from simulation time `time` s of a run; its end if that is None.

    `span`: as for `state_at`. Raises `StudyError` for a time that was not recorded, or at which no sample of a lab falls.
    """
    span = span or recording_span(recording)
    scenario, state = state_at(recording, span[1] if time is None else time, span)
    # A run without a screen may have been sampled at another rate than a lab's.
    exact = state.tick * recording.sample_period
    tick = round(exact / TICK)
    if abs(tick * TICK - exact) > 1e-9 * max(exact, 1.0):
        raise StudyError(
            f"t = {exact:.10g} s is no instant of a lab, which takes a sample every {MILLI * TICK:g} ms: choose a multiple."
        )
    return scenario, Origin(recording.path.stem, tick * TICK, replace(state, tick=tick))
