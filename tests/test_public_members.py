"""No member of a public class, which scripts and notebooks may use, is removed by accident.

`public_members.txt` lists them all. After adding one, or removing one on purpose and saying so in the changelog, write the file
anew: `python tests/test_public_members.py`.
"""

from pathlib import Path

import flexlab
from flexlab.analysis.leaderboard.entry import Row
from flexlab.analysis.metrics.run_metrics import MetricRow
from flexlab.analysis.tuning import Candidate, Cost
from flexlab.analysis.validation.check import Check

LISTED = Path(__file__).with_name("public_members.txt")
IN_RESULTS = (Candidate, Check, Cost, MetricRow, Row)
"""Classes that users meet only in results, such as the cost of a tuning."""


def classes() -> dict[str, type]:
    """Return the public classes by name."""
    public = [value for name in flexlab.__all__ if isinstance(value := getattr(flexlab, name), type)]
    return {kind.__name__: kind for kind in sorted([*public, *IN_RESULTS], key=lambda kind: kind.__name__)}


def members(kind: type) -> list[str]:
    """Return the public names of a class, its own and inherited from flexlab, with fields that have no default."""
    of_flexlab = [each for each in kind.__mro__ if each.__module__.startswith("flexlab")]
    return sorted(
        {
            name
            for each in of_flexlab
            for name in {*vars(each), *vars(each).get("__annotations__", {})}
            if name[0] != "_"
        }
    )


def listing() -> str:
    """Return a line for each class."""
    return "".join(f"{name}: {' '.join(members(kind))}\n" for name, kind in classes().items())


def test_members_of_public_classes_are_those_that_are_listed():
    listed = dict(line.split(": ") for line in LISTED.read_text(encoding="utf-8").splitlines())
    now = {name: set(members(kind)) for name, kind in classes().items()}
    gone = {name: lost for name, words in listed.items() if (lost := set(words.split()) - now.get(name, set()))}
    assert not gone, "scripts and notebooks may use them"
    assert LISTED.read_text(encoding="utf-8") == listing(), "write it anew: python tests/test_public_members.py"


if __name__ == "__main__":
    LISTED.write_text(listing(), encoding="utf-8")
