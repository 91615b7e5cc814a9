"""Entry point of `flexlab` and `python -m flexlab`: Ctrl-C ends them without a traceback, even while modules load."""

import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

AGAIN = 0.05
"""Time after which a Ctrl-C that Python dropped is repeated, s."""


def main() -> None:
    """Run `flexlab.cli.main`. Any error after Ctrl-C counts as an interruption."""
    # Otherwise a signal.py in the working folder would replace Python's in every process that flexlab starts.
    if not os.path.samefile(os.curdir, Path(__file__).parents[1]):
        os.environ.setdefault("PYTHONSAFEPATH", "1")
    pressed = False

    def press(number: int, frame: Any) -> None:
        nonlocal pressed
        pressed = True
        signal.default_int_handler(number, frame)

    def press_again(ignored: Any) -> None:
        if ignored.exc_type is not KeyboardInterrupt:
            return sys.__unraisablehook__(ignored)
        # Another thread presses once this callback is over.
        threading.Timer(AGAIN, signal.raise_signal, (signal.SIGINT,)).start()

    # Python drops Ctrl-C where nothing can be raised, as in the callbacks of its own imports.
    sys.unraisablehook = press_again
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # In the background it is ignored.
        signal.signal(signal.SIGINT, press)
    try:
        from flexlab.cli import main

        main()
    except BaseException as error:
        if not pressed or isinstance(error, SystemExit):
            raise
        os._exit(128 + signal.SIGINT)


if __name__ == "__main__":
    main()
