"""Changes that have a person's own code run: carried out one after the other beside the page, which must not wait for it."""

import threading
from collections.abc import Callable, Mapping
from typing import Any

from flexlab.errors import FlexlabError
from flexlab.log_limits import limited

PATH = "trajectory"

log = limited(__name__)


class SlowChanges:
    """What is asked for while another change is worked at waits, merged: the last value of a field counts."""

    def __init__(self, carry_out: Callable[[Mapping[str, Any]], None], say: Callable[[str, str], None]):
        """`say(sentence, level)`: what becomes of a change that is refused."""
        self._carry_out, self._say = carry_out, say
        self._lock = threading.Lock()
        self._waiting: dict[str, Any] = {}
        self._is_busy = False

    @property
    def is_busy(self) -> bool:
        """Whether a change of the path must wait for another one."""
        return self._is_busy

    def ask(self, changes: Mapping[str, Any]) -> None:
        """Carry a change out on a thread of its own. Any thread."""
        with self._lock:
            if f"{PATH}.kind" in changes or PATH in changes:  # Fields of the path that is left mean nothing any more.
                self._waiting = {path: value for path, value in self._waiting.items() if not path.startswith(PATH)}
            self._waiting.update(changes)
            if not self._is_busy:
                self._is_busy = True
                threading.Thread(target=self._work, name="flexlab-own-path", daemon=True).start()

    def _work(self) -> None:
        while True:
            with self._lock:
                changes, self._waiting = self._waiting, {}
                if not changes:
                    self._is_busy = False
                    return
            try:
                self._carry_out(changes)
            except FlexlabError as error:
                self._say(str(error), "error")
            except Exception as error:
                log.exception("a change failed")
                self._say(f"This change failed ({type(error).__name__}: {error}); the simulation goes on.", "error")
