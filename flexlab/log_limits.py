"""Logs that nobody can flood: of lines that are alike many at once, then one a second, with the number of those left out."""

import logging
import time

PERIOD = 1.0
"""s between two lines that are alike, once there have been many."""
BURST = 200.0
"""Lines that may come at once."""
MOST_KINDS = 200
"""Kinds of lines that are told apart."""


class OneASecond(logging.Filter):
    """Bounds the records of each logger and message template, whatever their arguments."""

    def __init__(self) -> None:
        super().__init__()
        self._seen: dict[tuple[str, str], tuple[float, float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the record is written; the first after a pause says how many were left out."""
        key, now = (record.name, str(record.msg)[:200]), time.monotonic()
        if key not in self._seen and len(self._seen) >= MOST_KINDS:
            self._seen.clear()
        at, credit, left_out = self._seen.get(key, (now, BURST, 0))
        credit = min(BURST, credit + (now - at) / PERIOD)
        if credit < 1.0:
            self._seen[key] = now, credit, left_out + 1
            return False
        self._seen[key] = now, credit - 1.0, 0
        if left_out:
            record.msg, record.args = f"{record.getMessage()} (and {left_out} more like this)", ()
        return True


def limited(name: str) -> logging.Logger:
    """The logger of a module that tells what visitors do, or of a library that does."""
    logger = logging.getLogger(name)
    if not any(isinstance(present, OneASecond) for present in logger.filters):
        logger.addFilter(OneASecond())
    return logger
