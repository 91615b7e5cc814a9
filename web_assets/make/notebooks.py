"""Runs the notebooks in `web_assets/notebooks` and stores what their cells print and draw: `python web_assets/make/notebooks.py`.

Jupyter is not needed: the code cells of a notebook run one after the other in one namespace.
"""

import ast
import base64
import io
import json
import os
import sys
import tempfile
from contextlib import chdir, redirect_stdout
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
RESOLUTION = 72
"""Dots per inch of the stored pictures."""


def run_notebook(path: Path) -> dict[str, Any]:
    """Run a notebook, and return its content with the outputs of its code cells. Raises what a cell raises."""
    notebook, names = json.loads(path.read_text(encoding="utf-8")), {"__name__": "__main__"}
    count = 0
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        for cell in notebook["cells"]:
            if cell["cell_type"] == "code":
                count += 1
                cell["outputs"], cell["execution_count"] = _run("".join(cell["source"]), names), count
    return notebook


def _run(source: str, names: dict[str, Any]) -> list[dict[str, Any]]:
    """Run a cell, and return its outputs: what it prints, and the value of its last line."""
    tree, printed, value = ast.parse(source), io.StringIO(), None
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    with redirect_stdout(printed):
        exec(compile(tree, "<cell>", "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "<cell>", "eval"), names)
    outputs: list[dict[str, Any]] = []
    if printed.getvalue():
        outputs.append(
            {"output_type": "stream", "name": "stdout", "text": printed.getvalue().splitlines(keepends=True)}
        )
    if value is not None:
        outputs.append({"output_type": "display_data", "metadata": {}, "data": _data(value)})
    return outputs


def _data(value: Any) -> dict[str, Any]:
    if not isinstance(value, Figure):
        return {"text/plain": repr(value).splitlines(keepends=True)}
    picture = io.BytesIO()
    value.savefig(picture, format="png", dpi=RESOLUTION, metadata={"Software": None})
    return {"image/png": base64.b64encode(picture.getvalue()).decode()}


def main() -> int:
    """Run the notebooks named on the command line, or all."""
    for path in [Path(word) for word in sys.argv[1:]] or sorted(NOTEBOOKS.glob("*.ipynb")):
        text = json.dumps(run_notebook(path), indent=1, ensure_ascii=False) + "\n"
        path.write_text(text, encoding="utf-8")
        print(os.path.relpath(path))
    return 0


if __name__ == "__main__":
    sys.exit(main())
