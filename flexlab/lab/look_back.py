"""Looking back at the last minute of the run, and continuing from an earlier instant."""

from dataclasses import dataclass, replace

from flexlab.errors import LabError
from flexlab.lab.lab_state import LabState
from flexlab.sim.commands import Pause, Play
from flexlab.sim.history import HISTORY_SECONDS, state_from
from flexlab.sim.samples import Origin, Samples
from flexlab.sim.snapshot import TICK, Snapshot


@dataclass(frozen=True)
class _Past:
    """The past instant that is shown. It is dropped when anything else happens to the run."""

    ago: float
    """Time before the instant at which the run is paused, s."""
    run_number: int
    asked: int
    """Number of the command that paused the run, as counted by `Snapshot.answered`."""
    went: bool
    """Whether the run was playing before."""


class LookBack:
    """Pauses the run while somebody looks back at its past. Thread-safe."""

    def __init__(self, lab_state: LabState):
        self._lab_state, self._runner = lab_state, lab_state.runner
        self._past: _Past | None = None

    @property
    def ago(self) -> float:
        """How far the screen looks back, s; 0 if it shows the present."""
        past, now = self._past, self._runner.snapshot
        if past is None:
            return 0.0
        if now.run_number != past.run_number or now.answered > past.asked:
            self._past = None
            return 0.0
        return min(past.ago, self.reach)

    @property
    def reach(self) -> float:
        """How far one can look back, s."""
        now = self._runner.snapshot
        oldest = self._runner.checkpoint(0.0).state.tick * TICK
        return min(max(float(now.latest.time[0]) - max(oldest, now.start_time), 0.0), HISTORY_SECONDS)

    def look(self, ago: float) -> None:
        """Pause the run and show it as it was `ago` s ago, if it has a past; 0 or less for the present.

        Raises `LabError` if the lab is locked.
        """
        if min(ago, self.reach) <= 0:
            self.back_to_now()
        elif self.ago > 0 and self._past is not None:
            self._past = replace(self._past, ago=ago)
        else:
            now, went = self._runner.snapshot, self._lab_state.playing
            asked = self._lab_state.submit(Pause()) if went else now.answered
            self._past = _Past(ago, now.run_number, asked, went)

    def back_to_now(self) -> None:
        """Show the present; a run that was playing before plays again."""
        went = self._past is not None and self.ago > 0 and self._past.went
        self._past = None
        if went and not self._runner.snapshot.status.failed:
            self._lab_state.submit(Play())

    def go_on(self) -> None:
        """Start a run that continues from the shown instant, with its exact state. Raises `FlexlabError`."""
        ago = self.ago
        if not ago:
            raise LabError("There is nothing to continue from: look back first.")
        now = self._runner.snapshot
        tick = round((float(now.latest.time[0]) - ago) / TICK)
        checkpoint = self._runner.checkpoint(tick * TICK)
        origin = Origin(self._lab_state.outside.recorded_as() or now.name, tick * TICK, state_from(checkpoint, tick))
        self._lab_state.go_on(checkpoint.scenario, origin)
        self._lab_state.submit(Play())
        self._past = None

    def seen(self, now: Snapshot) -> Snapshot:
        """The snapshot that the screen shows; `now` is the present."""
        ago = self.ago
        if not ago:
            return now
        sample = self.recent(0.0)
        if not len(sample):
            return now
        checkpoint = self._runner.checkpoint(float(sample.time[0]))
        return replace(
            now, scenario=checkpoint.scenario, first_frequency=checkpoint.first_frequency, latest=sample, display=sample
        )

    def recent(self, seconds: float) -> Samples:
        """The samples of the last `seconds` up to the shown instant, at full rate."""
        return self._runner.recent(seconds, self.ago)
