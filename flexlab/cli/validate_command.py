"""`flexlab validate`: check against the paper and mechanics, with a report."""

import time
from pathlib import Path
from typing import Annotated

from flexlab.cli.console import complain, new_table, output, print_json, tell
from flexlab.cli.options import option
from flexlab.cli.warmup import loading, warm_up


def command(
    to: Annotated[Path, option("File of the report, with figures.", "FILE.html", default=None)] = Path(
        "validation.html"
    ),
    as_json: Annotated[bool, option("Print the table as JSON.", name="json")] = False,
) -> int:
    """Check the paper's statements, closed formulas, mass points, energy and both theorems; write a report.

    Exits with 0 if every statement holds, with 1 if not.
    """
    with loading():
        from flexlab.analysis.validation import validate
        from flexlab.analysis.validation.report import write_report
        from flexlab.files import check_writing, make_folder
        from flexlab.presets import load_preset

    make_folder(to.parent, "choose another file")
    check_writing(to, ".html")
    warm_up(load_preset("paper"))
    began = time.perf_counter()
    found = validate()
    took = time.perf_counter() - began
    write_report(found, to, took)
    count, failed = len(found.checks), sum(not check.holds for check in found.checks)
    if as_json:
        print_json({subject: [vars(check) for check in checks] for subject, checks in found.groups.items()})
    else:
        for subject, checks in found.groups.items():
            table = new_table("statement", "expected", "here", "holds", title=subject, title_justify="left")
            for check in checks:
                table.add_row(check.statement, check.expected, check.found, "yes" if check.holds else "NO")
            output().print(table)
            output().print()
        tell(f"{count - failed} of {count} statements hold, in {took:.1f} s. Report: {to}")
    if failed:
        complain(f"{failed} of {count} statements do not hold: do not trust what this installation computes.")
    return 1 if failed else 0
