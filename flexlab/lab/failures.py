"""What goes wrong in a lab is a sentence on its screen, and the simulation goes on."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from flexlab.errors import FlexlabError
from flexlab.text import limited

log = limited(__name__)


@contextmanager
def telling(tell: Callable[[str], object], failed: str) -> Iterator[None]:
    """Tell what goes wrong in the block. What nobody expected goes to the log as well, and in brackets into `failed`."""
    try:
        yield
    except FlexlabError as error:
        tell(str(error))
    except Exception as error:
        log.exception(failed)
        tell(failed.format(f"{type(error).__name__}: {error}"))
