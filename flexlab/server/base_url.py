"""Serves below a base URL that a hub or a reverse proxy gives, as in "/user/ann/flexlab" before every address.

No other module knows of it. Requests lose the prefix before they are routed, unless the proxy has removed it already; links in
pages, redirects and cookies get it. Scripts read it from their own address; the lab's page has relative addresses only.
"""

import re
from collections.abc import Callable
from typing import Any

from aiohttp import hdrs, web

from flexlab.server.connections import Handler

_ADDRESS = re.compile(rb'((?:href|src|action|formaction|data-address|data-cells|data-recording|data-state)=")/(?!/)')
"""The beginning of an address of this server in an attribute of a page."""

JUPYTER = "X-Forwarded-Context"
"""The request header that identifies jupyter-server-proxy."""


def take_off(base: str, make_request: Callable[..., Any]) -> Callable[..., Any]:
    """A request factory of aiohttp that removes the prefix `base`."""

    def made(message: Any, *words: Any) -> Any:
        if message.path == base or message.path.startswith((f"{base}/", f"{base}?")):
            url = message.url
            path = url.raw_path[len(base) :] or "/"
            inner = url.build(path=path, query_string=url.raw_query_string, encoded=True)
            message = message._replace(path=message.path[len(base) :] or "/", url=inner)
        return make_request(message, *words)

    return made


def put_before(base: str) -> Any:
    """The outermost middleware, which puts the prefix `base` before every address in an answer."""

    @web.middleware
    async def with_base(request: web.Request, handler: Handler) -> web.StreamResponse:
        try:
            answer = await handler(request)
        except web.HTTPException as error:
            _complete(base, request, error)
            raise
        if not answer.prepared:
            _complete(base, request, answer)
            if (
                isinstance(answer, web.Response)
                and answer.content_type == "text/html"
                and isinstance(answer.body, bytes)
            ):
                answer.body = _ADDRESS.sub(rb"\1" + base.encode() + b"/", answer.body)
        return answer

    return with_base


def _complete(base: str, request: web.Request, answer: web.StreamResponse) -> None:
    """Put the prefix before the addresses of redirects and cookies."""
    to = answer.headers.get(hdrs.LOCATION, "")
    if to.startswith("/"):
        # jupyter-server-proxy 4.6 and later puts the prefix before absolute addresses again, but not before relative ones.
        up = "./" + "../" * (request.rel_url.raw_path.count("/") - 1)
        answer.headers[hdrs.LOCATION] = up + to[1:] if JUPYTER in request.headers else base + to
    before, url, to = answer.headers.get("Refresh", "").partition("url=/")
    if url:
        answer.headers["Refresh"] = f"{before}url={base}/{to}"
    for cookie in answer.cookies.values():
        cookie["path"] = base + cookie["path"]
