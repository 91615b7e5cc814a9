"""Fits the newest free ring of a running lab beside it."""

import threading
from dataclasses import dataclass

from flexlab.analysis.identification.remedies import Remedies, remedies
from flexlab.analysis.identification.ring import RingFit, fit_ring
from flexlab.analysis.identification.tap import recent_ring
from flexlab.errors import FlexlabError
from flexlab.log_limits import limited
from flexlab.sim.runner import Runner

LOOKED_BACK = 30.0
"""s in which a ring is looked for: all that a runner keeps."""

log = limited(__name__)


@dataclass(frozen=True)
class FittedRing:
    """What a ring told."""

    fit: RingFit
    since: str
    """What made it ring, as in "the tap at t = 1.200 s"."""
    remedies: Remedies | None


class RingStudy:
    """Holds the newest result; one fit runs at a time."""

    def __init__(self, runner: Runner):
        self._runner = runner
        self._lock = threading.Lock()
        self._is_busy = False
        self.result: FittedRing | None = None
        """None before the first, and where there was nothing to fit."""
        self.problem = ""
        """Why there is no result, as a sentence."""

    @property
    def is_busy(self) -> bool:
        """Whether a fit is under way."""
        return self._is_busy

    def ask(self) -> None:
        """Have the ring fitted that is there now."""
        with self._lock:
            if self._is_busy:
                return
            self._is_busy = True
        threading.Thread(target=self._work, name="flexlab-ring", daemon=True).start()

    def _work(self) -> None:
        try:
            snapshot, samples = self._runner.snapshot, self._runner.recent(LOOKED_BACK)
            time, signal, since = recent_ring(samples, snapshot.events)
            fit = fit_ring(time, signal)
            self.result, self.problem = FittedRing(fit, since, remedies(fit, snapshot.scenario)), ""
        except FlexlabError as error:
            self.result, self.problem = None, str(error)
        except Exception as error:
            log.exception("a fit failed")
            self.result, self.problem = None, f"The ring could not be fitted ({type(error).__name__}: {error})."
        finally:
            self._is_busy = False
