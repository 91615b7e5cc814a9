"""Data beside a law or path, as the weights of a network: they become a part of its text when the file is read.

So recordings, archives, replays and other machines have them, and a person is asked about what will run, all of it.
"""

import ast
import base64
import io
import re
import sys
from pathlib import Path

from flexlab.errors import ScenarioError
from flexlab.own.reading import LONGEST_SOURCE, called
from flexlab.text import syntax_tree

MOST_DATA = LONGEST_SOURCE * 5 // 8
"""Bytes of a file: as text they need a third more, and the law stands beside them."""
_KEPT = re.compile(
    r'(data_file\(\s*"[^"\\]{1,200}"), "((?:[A-Za-z0-9+/]{4})*(?:[A-Za-z0-9+/]{2}==|[A-Za-z0-9+/]{3}=)?)"\)'
)


def data_file(name: str, kept: str = "") -> io.BytesIO:
    """The data of a file that lies beside the law or path, as `np.load(data_file("weights.npz"))` wants them.

    flexlab adds `kept`, the file's bytes in base64, when it reads the law, so that its recordings are complete. Up to 125 kB.
    Raises `OSError` where there is no such file.
    """
    if kept:
        return io.BytesIO(base64.b64decode(kept))
    beside = sys._getframe(1).f_globals.get("__file__", "")
    return io.BytesIO((Path(beside).parent / name).read_bytes())


def with_data(text: str, folder: Path, field: str) -> str:
    """A text with the data that it names added, as they are in `folder`. Lines keep their numbers.

    `field`: of the scenario, for what is wrong. Raises `ScenarioError` for a file that cannot be kept.
    """
    if "data_file" not in text:
        return text
    try:
        tree = syntax_tree(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return text  # Whoever reads its declarations says so.
    lines = text.split("\n")
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and called(node.func) == "data_file"]
    # From the end, so that places before stay what they are.
    for call in sorted(calls, key=lambda node: (node.lineno, node.col_offset), reverse=True):
        if len(call.args) != 1 or call.keywords:
            continue
        name = call.args[0]
        if not isinstance(name, ast.Constant) or not isinstance(name.value, str) or name.end_lineno is None:
            raise _problem(field, call, "data_file needs the name of a file, written out")
        line = lines[name.end_lineno - 1].encode()
        kept = f", {_encoded(name.value, folder, field, call)!r}".replace("'", '"').encode()
        lines[name.end_lineno - 1] = (line[: name.end_col_offset] + kept + line[name.end_col_offset :]).decode()
    return "\n".join(lines)


def without_data(text: str) -> str:
    """A text to be read: of the data that it keeps, how much they are."""
    return _KEPT.sub(lambda found: f'{found[1]}, "{len(base64.b64decode(found[2]))} bytes")', text)


def _encoded(name: str, folder: Path, field: str, call: ast.Call) -> str:
    file = folder / name
    if not name or Path(name).name != name or file.is_symlink():
        raise _problem(field, call, f"data_file({name!r:.80}): give the name of a file in the same folder")
    try:
        if not file.is_file():
            raise _problem(field, call, f"data_file({name!r:.80}): there is no such file in {folder}")
        if file.stat().st_size > MOST_DATA:
            size = file.stat().st_size
            raise _problem(field, call, f"data_file({name!r:.80}): it has {size} bytes, {MOST_DATA} are the most")
        return base64.b64encode(file.read_bytes()).decode()
    except OSError as error:
        raise _problem(field, call, f"data_file({name!r:.80}): it cannot be read ({error.strerror})") from None


def _problem(field: str, call: ast.Call, text: str) -> ScenarioError:
    return ScenarioError([(field, f"Line {call.lineno}: {text}.")])
