"""`flexlab leaderboard`: compare control laws, including yours, case by case."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from flexlab.cli.console import complain, new_table, note, output, tell
from flexlab.cli.options import Cluster, Several, Threads, keep_own_texts_apart, option
from flexlab.cli.warmup import loading, warm_up
from flexlab.errors import StudyError
from flexlab.text import counted

if TYPE_CHECKING:
    from flexlab.analysis.leaderboard.board import Leaderboard
    from flexlab.analysis.leaderboard.entry import Row, Task
    from flexlab.analysis.leaderboard.report import Grid
    from flexlab.analysis.leaderboard.store import RowStore
    from flexlab.analysis.workers import Workers


def command(
    law: Annotated[
        Several, option("The Python file of a law of your own to include; may be repeated.", "FILE.py")
    ] = (),
    law_name: Annotated[Several, option("Only this one of flexlab's laws; may be repeated.", "KIND")] = (),
    case: Annotated[Several, option("Only this case; may be repeated.", "B1…B8")] = (),
    long: Annotated[bool, option("Include B7: ten minutes of each law.")] = False,
    seed: Annotated[int, option("Seed of the sensor noise.", "N", default=None)] = 0,
    to: Annotated[
        Path | None, option("Write leaderboard.html, the table as Parquet and CSV, and a figure per case.", "FOLDER")
    ] = None,
    verify: Annotated[bool, option("Compute the stored rows again, and compare every bit.")] = False,
    workers: Threads = None,
    cluster: Cluster = None,
) -> int:
    """Compare control laws in the cases B1 to B8. Rows that the folder leaderboard has are not computed again.

    A law that fails says why. Exits with 1 if --verify finds a difference.
    """
    with loading():
        from flexlab.analysis.leaderboard.board import make_tasks, run_board
        from flexlab.analysis.leaderboard.case import chosen_cases
        from flexlab.analysis.leaderboard.entry import chosen_entrants
        from flexlab.analysis.leaderboard.report import write_report
        from flexlab.analysis.leaderboard.store import FOLDER, RowStore
        from flexlab.analysis.workers import chosen_workers, progress_bar
        from flexlab.files import make_folder
        from flexlab.presets import load_preset

    if verify and to is not None:
        raise StudyError("--verify compares stored rows and writes no report: give one of --verify and --to.")
    known = chosen_workers(workers, cluster)
    keep_own_texts_apart()
    cases = chosen_cases(case or None, long)
    tasks = make_tasks(cases, chosen_entrants(law_name or None, law), seed)
    store = RowStore(FOLDER)
    if to is not None:
        make_folder(to)
    if cluster is None:
        warm_up(load_preset("paper"))
    if verify:
        kept = [row for row in store.last() if row.case in {case.name for case in cases}]
        # Without a choice of laws, all rows are verified; one whose law is not given cannot be computed and says so.
        chosen = {task.row.place for task in tasks}
        return _verify([row for row in kept if not law_name or row.place in chosen], tasks, store, known)
    with progress_bar(True, "rows") as told:
        board = run_board(tasks, store, known, told)
    _print(board)
    if to is not None:
        tell(*write_report(board, to))
    note(f"{counted(len(board.rows), 'row')}, {board.computed} of them computed now.")
    if not case and not long:
        note("B7 simulates ten minutes of each law, which takes some minutes: --long adds it.")
    return 0


def _verify(rows: "list[Row]", tasks: "tuple[Task, ...]", store: "RowStore", workers: "Workers") -> int:
    from flexlab.analysis.leaderboard.board import verify
    from flexlab.analysis.workers import progress_bar

    if not rows:
        raise StudyError(f"{store.folder} holds no such rows: flexlab leaderboard computes them.")
    with progress_bar(True, "rows") as told:
        found = list(verify(rows, tasks, workers, told))
    odd = [(row.place, difference) for row, difference in found if difference]
    for place, difference in odd:
        complain(f"{' '.join(filter(None, place))}: {difference}.")
    output().print(f"Rows that are the same, bit for bit: {len(found) - len(odd)} of {len(found)}.")
    return 1 if odd else 0


def _print(board: "Leaderboard") -> None:
    from flexlab.analysis.leaderboard.report import OF_THE_BEST, SEVERAL, overview, provenance, sections, settings

    _print_grid(f"Overview: {OF_THE_BEST} that ranks; {SEVERAL}", overview(board))
    for section in sections(board):
        case = section.case
        _print_grid(f"{case.name} {case.title}: {case.main.column.title}, {case.main.column.unit}", section.main)
        for score in case.scores if not section.details else (case.main,):
            tell(f"  {score.column.label} = {score.formula}", style="dim")
        tell(*(f"  {sentence}" for sentence in section.failures), style="red")
        output().print()
    if unusual := "; ".join(f"{law}: {', '.join(parts)}" for law, parts in settings(board).items()):
        tell(f"Settings other than a law's own: {unusual}.")
    tell(provenance(board))


def _print_grid(title: str, grid: "Grid") -> None:
    from rich.text import Text

    table = new_table(title=title, title_justify="left")
    table.add_column("law", no_wrap=True, min_width=max((len(law) for law, _ in grid.lines), default=0))
    for head in grid.heads:
        table.add_column(head, justify="right")
    for law, cells in grid.lines:
        styles = ("bold" if cell.level == 0 else "red" if cell.level is None else "" for cell in cells)
        table.add_row(law, *(Text(cell.text, style) for cell, style in zip(cells, styles, strict=True)))
    output().print(table)
