"""`flexlab review [RUN]`: open a recording, the newest by default."""

from flexlab.cli.options import LOGS, Logs, NoBrowser, Run, ViewerPort
from flexlab.cli.showing import show_review


def command(run: Run = "newest", no_browser: NoBrowser = False, port: ViewerPort = 0, logs: Logs = LOGS) -> None:
    """Open a recording in the rerun viewer, in your browser."""
    from flexlab.recording.store.run_files import find_run

    path = find_run(run, logs)
    show_review(path, str(path), browser=not no_browser, port=port)
