"""Questions before something that cannot be undone."""

from flexlab.cli.console import notes
from flexlab.errors import StudyError


def agreed(question: str, otherwise: str) -> bool:
    """Whether the person answers yes. Raises `StudyError` if nobody is there to answer; `otherwise` says what to do then."""
    notes().print(f"{question} [y/N] ", end="", soft_wrap=True)
    try:
        return input().strip().lower() in ("y", "yes")
    except EOFError:
        notes().print()
        raise StudyError(f"Nobody answered, so nothing was done: {otherwise}.") from None
