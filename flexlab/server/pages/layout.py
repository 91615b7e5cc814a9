"""The frame around every page of the server, and pages that say one sentence."""

from aiohttp import web

from flexlab.server.pages.markup import Markup, fill, join

PAGE_POLICY = (
    "default-src 'none'; style-src 'self'; script-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'self'"
)
"""The server's own pages load from this address only, and run no script that stands in the page."""

FRAME = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<link rel="icon" href="/static/icon.svg">
<link rel="stylesheet" href="/static/style.css">
{head}
</head>
<body class="{kind}">
<header>
<a class="brand" href="/"><img src="/static/icon.svg" alt="" width="28" height="28">flexlab</a>
<nav>{links}</nav>
</header>
<main>
{body}
</main>
</body>
</html>
"""
NOTHING = Markup("")
LINKS = (("/lab/", "Lab"), ("/runs", "Runs"))


def page(
    title: str, body: Markup, *, here: str = "", kind: str = "text", head: Markup = NOTHING, status: int = 200
) -> web.Response:
    """A page of the server. `here`: the address of the link that is lit; `kind`: class of the body."""
    links = join(
        fill(
            '<a href="{to}"{lit}>{word}</a>', to=to, word=word, lit=Markup(' aria-current="page"' if to == here else "")
        )
        for to, word in LINKS
    )
    name = title if title == "flexlab" else f"{title} · flexlab"
    text = fill(FRAME, title=name, head=head, kind=kind, links=links, body=body)
    headers = {"Content-Security-Policy": PAGE_POLICY, "Cache-Control": "no-store"}
    # Whatever was stored, a page goes out: what is no text is shown as "?".
    body_bytes = text.encode("utf-8", "replace")
    return web.Response(body=body_bytes, content_type="text/html", charset="utf-8", status=status, headers=headers)


def message(title: str, sentence: str, status: int, more: Markup = NOTHING) -> web.Response:
    """A page that says what happened and what to do. `more`: buttons."""
    paragraphs = join(fill("<p>{line}</p>", line=line) for line in sentence.splitlines())
    more = more or Markup('<a class="button" href="/">Start page</a>')
    body = fill('<section class="message"><h1>{title}</h1>{text}<p class="actions">{more}</p></section>',
                title=title, text=paragraphs, more=more)  # fmt: skip
    return page(title, body, status=status)
