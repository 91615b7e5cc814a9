"""The languages that pages can be shown in: one catalogue each, `web_assets/languages/CODE.json`.

A catalogue maps English texts to those of its language; `{name}` stands for any part of a sentence, and the marks of markdown
for what a page shows in bold, as code or as a link. Its entry `English` is the language's own name. The page translates itself
(`static/language.js`): the panel of a shared lab is the same for all who look at it.
"""

import json
from functools import cache
from pathlib import Path

from markupsafe import Markup

from flexlab.assets import web_assets_folder


@cache
def catalogues() -> dict[str, Path]:
    """Code of the language, as in `<html lang>` → file."""
    return {file.stem: file for file in sorted((web_assets_folder() / "languages").glob("*.json"))}


def read_catalogue(file: Path) -> dict[str, str]:
    """English text → text of the language."""
    return json.loads(file.read_text(encoding="utf-8"))


@cache
def language_script() -> Markup:
    """The element by which a page shows itself in the reader's language."""
    names = {code: read_catalogue(file).get("English", code) for code, file in catalogues().items()}
    return Markup('<script src="/static/language.js" data-languages="{}"></script>').format(
        json.dumps(names, ensure_ascii=False)
    )
