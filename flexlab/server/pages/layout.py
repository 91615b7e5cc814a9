"""Answers that are pages of the server, and pages that say one sentence."""

from collections.abc import Sequence

from aiohttp import web
from markupsafe import Markup

from flexlab.server.pages.templating import button, render

PAGE_POLICY = (
    "default-src 'none'; style-src 'self'; script-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'self'"
)
"""The server's own pages load from this address only, and run no script that stands in the page."""


def page(
    template: str,
    title: str,
    *,
    here: str = "",
    kind: str = "text",
    scripts: Sequence[str] = (),
    status: int = 200,
    **values: object,
) -> web.Response:
    """A page of the server. `here`: the address of the link that is lit; `kind`: class of the body; `scripts`: of static/."""
    text = render(template, title=title, here=here, kind=kind, scripts=scripts, **values)
    headers = {"Content-Security-Policy": PAGE_POLICY, "Cache-Control": "no-store"}
    return web.Response(text=text, content_type="text/html", status=status, headers=headers)


def message(title: str, sentence: str, status: int, more: Markup | None = None) -> web.Response:
    """A page that says what happened and what to do. `more`: buttons."""
    more = more or button("/", "Start page")
    return page("message.html", title, sentence=sentence, more=more, status=status)
