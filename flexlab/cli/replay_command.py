"""`flexlab replay [RUN]`: simulate again and compare, bit for bit."""

from typing import Annotated

from flexlab.cli.console import agreed, note, tell
from flexlab.cli.options import LOGS, Logs, Run, keep_own_texts_apart, option
from flexlab.cli.warmup import loading, warm_up
from flexlab.text import visible

RunOwnLaw = Annotated[
    bool,
    option("Run a control law that came with the recording as Python code, or connect to its program, without asking."),
]


def command(run: Run = "newest", logs: Logs = LOGS, run_own_law: RunOwnLaw = False) -> int:
    """Simulate RUN, or an archive of one (.zip), again from its start and its commands, and compare every bit.

    Where bits differ, a run that was recorded before results were the same on every machine, or with a control law in Python,
    is compared within a tolerance. Prints which comparison was made, or when and in which signal the run first differs, and
    what recorded it. Exits with 0 if the run is reproduced, with 1 if not.
    """
    with loading():
        from flexlab.analysis.capsule import opened_run
        from flexlab.analysis.replay import allow_own_laws, replay
        from flexlab.analysis.workers import progress_bar
        from flexlab.recording.reader import read_recording

    def agrees(_: str, question: str, code: str) -> bool:
        if code and not run_own_law:
            note(visible(code))
        return run_own_law or agreed(question, "give --run-own-law to let it run")

    with opened_run(run, logs) as path:
        recording = read_recording(path)
        keep_own_texts_apart()
        allow_own_laws(recording, agrees)
        warm_up(recording.scenario)
        with progress_bar(True, "replaying", "{task.completed:.0f} s") as told:
            found = replay(recording, lambda time: told(time, recording.status.time or None))  # 0: unknown
    tell(f"{path.stem}: {found.text}")
    return 0 if found.agrees else 1
