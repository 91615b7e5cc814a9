"""Entry point of `flexlab` and `python -m flexlab`: Ctrl-C ends them without a traceback, even while modules load.

So do `kill` and a closed terminal: what a command has recorded is then whole.
"""

import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

from flexlab.interrupts import wanted

AGAIN = 0.05
"""Time after which a Ctrl-C that Python dropped is repeated, s."""


def main() -> None:
    """Run `flexlab.cli.main`. Any error after a signal that ends it counts as an interruption."""
    # Otherwise a signal.py in the working folder would replace Python's in every process that flexlab starts.
    if not os.path.samefile(os.curdir, Path(__file__).parents[1]):
        os.environ.setdefault("PYTHONSAFEPATH", "1")
    # Small matrices are fastest on one thread, and idle threads of a library would spin on busy cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    pressed, tell = 0, sys.__unraisablehook__  # Kept: at Python's end this module has no names.

    def press(number: int, frame: Any) -> None:
        nonlocal pressed
        pressed = number
        signal.default_int_handler(number, frame)

    def press_again(ignored: Any) -> None:
        if ignored.exc_type is not KeyboardInterrupt:
            return tell(ignored)
        # Another thread presses once this callback is over.
        threading.Timer(AGAIN, signal.raise_signal, (pressed or signal.SIGINT,)).start()

    # Python drops Ctrl-C where nothing can be raised, as in the callbacks of its own imports.
    sys.unraisablehook = press_again
    for number in wanted():
        signal.signal(number, press)
    try:
        from flexlab.cli import main

        main()
    except SystemExit as end:
        if pressed and end.code == 128 + signal.SIGINT:
            end.code = 128 + pressed
        raise
    except BaseException:
        if not pressed:
            raise
        os._exit(128 + pressed)


if __name__ == "__main__":
    main()
