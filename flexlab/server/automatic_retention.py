"""Deletes the oldest runs over the limits that the lab was started with; runs that are kept, or being written, stay."""

import asyncio
import logging

from flexlab.errors import FlexlabError
from flexlab.recording.store.run_files import removable_runs, remove_run
from flexlab.server.settings import Settings

LOOK = 60.0
"""s between two looks."""

log = logging.getLogger(__name__)


async def tidy_up(settings: Settings) -> None:
    """Look at once and then again and again; returns only if there are no limits."""
    while settings.most_bytes is not None or settings.most_days is not None:
        await asyncio.to_thread(delete_over_limits, settings)
        await asyncio.sleep(LOOK)


def delete_over_limits(settings: Settings) -> None:
    """Delete them, and tell the person at the terminal."""
    try:
        for path in removable_runs(settings.logs, settings.most_bytes, settings.most_days):
            remove_run(path)
            log.warning("Deleted %s: it was over the limits that this lab was started with.", path.name)
    except (FlexlabError, OSError) as error:
        log.warning("Old runs could not be deleted: %s", error)
