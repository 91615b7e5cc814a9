"""Which texts in Python may run, and where each runs: in this process, or in one of its own where it can do no harm."""

import subprocess
import threading
from typing import Any

import numpy as np

from flexlab.compiled import PLAIN_PYTHON
from flexlab.errors import FlexlabError, ScenarioError
from flexlab.files import short_hash
from flexlab.own.apart import LawApart, PathApart
from flexlab.own.execution import RunningLaw, RunningPath
from flexlab.own.link import address_in
from flexlab.own.process import OwnProcess
from flexlab.own.reading import TextProblem, is_foreign
from flexlab.physics.law_input import LAW_INPUT

_KINDS = {"law": (RunningLaw, LawApart), "path": (RunningPath, PathApart)}
"""What runs a text in this process, and in one of its own."""
known: dict[tuple[str, str], Any] = {}
"""What runs the texts, by "law" or "path" and the text's digest; the one used last stands last."""
_lock = threading.RLock()
_allowed: dict[str, str] = {}
_apart = False


def run_apart(apart: bool = True, output: int = subprocess.DEVNULL) -> None:
    """Run texts in Python in processes of their own from now on, as a lab does, or in this one.

    output: the file to which the next processes print. Without compiled code all texts run in this process.
    """
    global _apart
    apart = apart and not PLAIN_PYTHON
    OwnProcess.output = output
    if _apart is not apart:
        close_all()
        _apart = apart


def host(sort: str, source: str) -> Any:
    """What runs an allowed text, a "law" or a "path". Raises `TextProblem` or `ScenarioError` if it cannot be run."""
    key, file = (sort, short_hash(source)), file_of(source)
    with _lock:
        found = known.pop(key, None)
        if found is None:
            apart = _apart or (is_foreign(file) and not PLAIN_PYTHON)
            found = _KINDS[sort][apart](source, file)
        known[key] = found
        _retire(sort, file)
    return found


def _retire(sort: str, file: str) -> None:
    """End the processes of a file's older texts; the engine may use the newest ones until a change reaches it."""
    apart = [(key, one) for key, one in reversed(known.items()) if isinstance(one, OwnProcess)]
    of_file = [key for key, one in apart if (one.sort, one.file) == (sort, file)]
    for number, key in enumerate(of_file):
        if number >= known[key].kept:
            known.pop(key).dispose()
        elif number >= known[key].running:
            known[key].close()


def stop_loading(file: str = "", source: str = "") -> None:
    """End the processes that are not ready yet, so that nobody waits for them; of a `file` saved anew as `source` the others."""
    for (_, text), one in list(known.items()):
        if not isinstance(one, OwnProcess) or one.is_loaded:
            continue
        if not file:
            one.close()
        elif one.file == file and text != short_hash(source):
            one.close("it was saved anew while it was loading.")


def close_all() -> None:
    """End all processes of laws and paths."""
    with _lock:
        for one in known.values():
            if isinstance(one, OwnProcess):
                one.close()
        known.clear()


def allow(source: str, file: str) -> None:
    """Let a text run that stands in `file`; sentences name that file."""
    _allowed[short_hash(source)] = file


def allowed() -> dict[str, str]:
    """File by digest of each text that may run, for another process (`allow_digests`)."""
    return dict(_allowed)


def allow_digests(files: dict[str, str]) -> None:
    """Allow what another process of the same person allows."""
    _allowed.update(files)


def file_of(source: str) -> str:
    """The file of a text that may run; empty for any other."""
    return _allowed.get(short_hash(source), "")


def is_allowed(source: str) -> bool:
    """Whether a text may run here."""
    return short_hash(source) in _allowed


def not_allowed(source: str, kind: str) -> str:
    """Why a law that came with a scenario does not run, and how to let it."""
    if address := address_in(source):
        return (
            f"The control law {kind} of this scenario is the program at {address}, to which flexlab does not connect by "
            f"itself. If it is yours, start it and give --law {address}, or answer yes where flexlab replay asks."
        )
    return (
        f"The control law {kind} came with this scenario as Python code, which does not run by itself. If you know who wrote "
        "it and have read it, allow it: give its file with --law, or answer yes where flexlab replay asks."
    )


def host_of(source: str, kind: str) -> RunningLaw | LawApart:
    """What runs a law, ready to be asked. Raises `ScenarioError` if it may not or cannot run."""
    if not is_allowed(source):
        raise ScenarioError([("controller.source", not_allowed(source, kind))])
    try:
        found = host("law", source)
        found.ensure()
    except (TextProblem, FlexlabError) as error:
        with _lock:
            known.pop(("law", short_hash(source)), None)
        raise ScenarioError([("controller.source", f"The control law {kind} cannot be used: {error}")]) from None
    return found


def known_law(source: str) -> RunningLaw | LawApart | None:
    """What runs a law; None if nothing does yet."""
    return known.get(("law", short_hash(source)))


def ask_plainly(gains: Any, now: Any) -> int:
    """One call of a law where kernels are not compiled (`compiled.PLAIN_PYTHON`): its outcome."""
    laws = [one for one in known.values() if isinstance(one, RunningLaw)]
    asked = next(law for law in laws if law.channel.answer == int(gains.answer))
    return asked.ask(gains, np.frombuffer(now.tobytes(), LAW_INPUT)[0])
