"""`flexlab replay [RUN]`: simulate again and compare, bit for bit."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

from flexlab.cli.console import agreed, complain, note, output
from flexlab.cli.options import LOGS, Logs, Run, option
from flexlab.errors import StudyError
from flexlab.text import visible

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples


RunOwnLaw = Annotated[
    bool,
    option(
        "Let a control law run that came with the recording as Python code, or connect to its program, without asking."
    ),
]


def command(run: Run = "newest", logs: Logs = LOGS, run_own_law: RunOwnLaw = False) -> int:
    """Simulate RUN, or an archive of one (.zip), again from its start and its commands, and compare every bit.

    A run that was recorded before results were the same on every machine, or under a control law in Python, is compared
    with a tolerance where bits differ. Says which of the two was done, or when and in which signal it first differs, and
    what recorded it. Exits with 0 if the run came out again, with 1 if not.
    """
    from flexlab.recording.store.run_files import find_run

    if not run.lower().endswith(".zip"):
        return _replay(find_run(run, logs), run_own_law)
    from flexlab.analysis.capsule import unpack_capsule

    with TemporaryDirectory(prefix="flexlab-") as folder:
        return _replay(unpack_capsule(Path(run), Path(folder)), run_own_law)


def _replay(path: Path, run_own_law: bool) -> int:
    """Replay a recording and print the result; returns the exit code."""
    from flexlab.recording.reader import read_blocks, read_recording

    recording = read_recording(path, with_samples=False)
    from flexlab.analysis.replay import own_law_texts, replay

    for kind, source in own_law_texts(recording):
        _allow(kind, source, run_own_law)
    from flexlab.cli.warmup import warm_up

    warm_up(recording.scenario)
    found = replay(recording, _counted(read_blocks(path), recording.status.time))
    output().print(f"{path.stem}: {found.text}", soft_wrap=True)
    if found.compared == 0 and found.agrees:
        complain("The recording has no samples: there was nothing to compare.")
        return 1
    return 0 if found.agrees else 1


def _allow(kind: str, source: str, allowed: bool) -> None:
    """Allow a recording's own law to run if the person agrees. Raises `StudyError` if not."""
    from flexlab.own import hosts
    from flexlab.own.files import LAW_FILES
    from flexlab.own.link import address_in
    from flexlab.own.reading import without_data
    from flexlab.own.unit import unit_in

    if hosts.is_allowed(source):
        return
    address, lines = address_in(source), len(source.splitlines())
    unit, unit_file = unit_in(source, (Path(), LAW_FILES.own))
    if unit and not unit_file:
        raise StudyError(
            f"The run was controlled by the unit {unit}, machine code that recordings do not hold: put that very file here "
            f"or into {LAW_FILES.own}, then replay again."
        )
    if not allowed:
        question = (
            f"This run was controlled by {kind}, Python code of {lines} lines that stands above. Let it run here?"
        )
        if address:
            question = (
                f"This run was controlled by the program at {address}, which a replay needs: it has to run there now. "
                "Connect to it?"
            )
        elif unit:
            question = (
                f"This run was controlled by the unit {unit_file}, machine code that a replay needs. Let it run here?"
            )
        else:
            note(visible(without_data(source)))
        if not agreed(question, "give --run-own-law to let it run"):
            raise StudyError(f"The run was not replayed: its control law {kind} was not allowed to run.")
    hosts.allow(source, address or unit_file or f"{kind.replace('-', '_')}.py")


def _counted(blocks: "Iterable[Samples]", end: float) -> "Iterator[Samples]":
    """The blocks, with a progress bar up to `end` s of simulation (0: unknown)."""
    from flexlab.analysis.workers import progress_bar

    with progress_bar(True, "replaying", "{task.completed:.0f} s") as told:
        for block in blocks:
            yield block
            told(float(block.time[-1]), end or None)
