"""The pages that follow from the code and from texts kept elsewhere; mkdocs calls this file, as its `hooks` say."""

import importlib
import inspect
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from markdown.extensions.toc import slugify
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from pydantic import BaseModel

import flexlab
from flexlab import cli, notation
from flexlab.analysis.metrics.metric import METRICS, numbers
from flexlab.control import motion
from flexlab.control.controller import Controller
from flexlab.control.law import Law, laws
from flexlab.control.path import Path as DesiredPath
from flexlab.control.path import Trajectory, paths
from flexlab.guide import chapters
from flexlab.quantities import Quantity, describe
from flexlab.scenario import Scenario
from flexlab.scenario.validation_errors import value_paths
from flexlab.sim.signals import known_signals
from flexlab.text import number_text

HOME = Path(__file__).parents[2]
KEPT_ELSEWHERE = {
    "index": "README.md",
    "contributing": ".github/CONTRIBUTING.md",
    "changes": ".github/CHANGELOG.md",
    "university": ".github/UNIVERSITY.md",
}
"""Page to the file that is its text."""
PLACES = {
    "](web_assets/docs/pages/": "](",
    "](../../../README.md": "](index.md",
    "](.github/UNIVERSITY.md": "](university.md",
}
"""Where links lead among the files of a checkout, and where on the site."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the guide's chapters in their place, and have anchors begin with a letter: the theme's scripts fail at "0.3.0"."""
    config.mdx_configs["toc"]["slugify"] = lambda text, between: re.sub(r"^(?=\d)", "v", slugify(text, between))
    for entry in config.nav or []:
        if "Guide" in entry:
            entry["Guide"] = [{chapter.title: f"guide/{chapter.id}.md"} for chapter in chapters()]
    return config


def on_page_markdown(markdown: str, **_: Any) -> str:
    """A page's text with links to pages of the site."""
    for place, page in PLACES.items():
        markdown = markdown.replace(place, page)
    return markdown


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add all pages that are not written by hand."""
    for name, text in generated().items():
        files.append(File.generated(config, f"{name}.md", content=text))
    return files


def on_post_page(output: str, **_: Any) -> str:
    """A page with what the theme's switch of light and dark looks for: without the highlighter it fails, and does nothing."""
    return output.replace("</head>", '<link id="hljs-light"><link id="hljs-dark"></head>', 1)


def generated() -> dict[str, str]:
    """Markdown of each page, by its name."""
    found = {page: (HOME / file).read_text(encoding="utf-8") for page, file in KEPT_ELSEWHERE.items()}
    found |= {f"guide/{chapter.id}": f"# {chapter.title}\n\n{chapter.text}" for chapter in chapters()}
    rows = [(one.symbol, f"`{one.code}`", *one[2:]) for one in notation.SYMBOLS]
    symbols = _table(("symbol", "in code", "word", "unit", "shape", "equation"), rows)
    return found | {
        "laws": "# Control laws\n\n" + "\n\n".join(_of_a_kind(law, Controller) for law in laws().values()),
        "paths": "# Paths and shapers\n\n"
        + "\n\n".join(_of_a_kind(path, Trajectory) for path in paths().values())
        + f"\n\n## Smooth start and input shapers\n\n{_docstring(motion)}",
        "python": "# Python\n\n" + "\n\n".join(f"::: {address}" for address in _public()),
        "commands": "# Command line\n\n" + "\n\n".join(map(_command, cli.COMMANDS)),
        "fields": f"# Fields of a scenario\n\n{_fields()}",
        "signals": f"# Signals\n\nOf `Samples`, in recordings and in tables. N: samples.\n\n{_signals()}",
        "metrics": f"# Metrics\n\nOf a run, in SI units.\n\n{_metrics()}",
        "symbols": f"# Symbols\n\n{inspect.getdoc(notation)}\n\n{symbols}",
    }


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |" for line in lines)


def _docstring(of: Any) -> str:
    """A docstring as markdown: indented lines, which are equations and lists, as they stand."""
    return inspect.getdoc(of) or ""


def _of_a_kind(one: Law | DesiredPath, common: type[BaseModel]) -> str:
    """A law or path: what its file says of it, and its fields."""
    module = inspect.getmodule(one.model)
    names = [name for name in one.model.model_fields if name not in {"kind", *common.model_fields}]
    fields = [_field(name, describe(one.model, name), one.model.model_fields[name].default) for name in names]
    table = _table(("field", "symbol", "meaning", "default", "range"), fields) if fields else ""
    return f"## {one.kind}\n\n{_docstring(module)}\n\n{table}"


def _field(path: str, about: Quantity, default: Any) -> tuple[str, ...]:
    value = default if isinstance(default, str) else "null" if default is None else _number(default)
    bounded = about.low > float("-inf") and about.high < float("inf")
    return f"`{path}`", about.symbol, about.title, value, about.range_text() if bounded else about.unit


def _number(value: Any) -> str:
    if isinstance(value, bool | int):
        return str(value)
    if isinstance(value, float):
        return number_text(value)
    return ", ".join(map(_number, value)) if isinstance(value, tuple | list) else ""


def _public() -> list[str]:
    """Where each public name of the package is defined, in the order of names."""
    return [f"{getattr(flexlab, name).__module__}.{name}" for name in flexlab.__all__ if name != "__version__"]


def _command(name: str) -> str:
    module = importlib.import_module(f"flexlab.cli.{name}{cli.ENDING}")
    options = []
    for parameter in inspect.signature(module.command).parameters.values():
        about = getattr(parameter.annotation, "__metadata__", ())
        for told in (each for each in about if hasattr(each, "metavar")):
            called = told.name or parameter.name.strip("_").replace("_", "-")
            option = "" if any("Positional" in repr(each) for each in about) else f"--{called} "
            options.append((f"`{option}{told.metavar or ''}`".replace(" `", "`"), told.help or ""))
    first = _docstring(module).partition("\n")[0]
    table = _table(("option", "meaning"), options) if options else ""
    return f"## {name}\n\n{first}\n\n{_docstring(module.command)}\n\n{table}"


def _fields() -> str:
    scenario = Scenario()
    values = ((path, scenario.get(path)) for path in value_paths(scenario))
    rows = (_field(path, scenario.about(path), value) for path, value in values if not isinstance(value, BaseModel))
    return _table(("field", "symbol", "meaning", "default", "range"), rows)


def _signals() -> str:
    rows = (
        (f"`{name}`", signal.symbol, signal.meaning, signal.unit_text, signal.shape_text, signal.equation)
        for name, signal in known_signals().items()
    )
    return _table(("name", "symbol", "meaning", "unit", "shape", "source"), rows)


def _metrics() -> str:
    rows = ((f"`{number.name}`", number.column.title, number.column.si_unit) for number in numbers())
    said = "\n\n".join(
        f"**{name}**: {re.sub(chr(10) + ' *', ' ', _docstring(metric))}" for name, metric in METRICS.items()
    )
    return f"{_table(('name', 'meaning', 'unit'), rows)}\n\n{said}"
