"""Checks every request before a page sees it: its form, where it comes from, and its token."""

import errno
import hmac
import re
from urllib.parse import quote, unquote

from aiohttp import hdrs, web
from aiohttp.http_exceptions import HttpProcessingError

from flexlab.errors import FlexlabError
from flexlab.recording.store.run_files import SUFFIX
from flexlab.recording.store.run_index import NoSuchRun
from flexlab.server.connections import MALFORMED, Handler
from flexlab.server.limits import BusyError, network_of
from flexlab.server.pages import ALL_RUNS, HAS_CLASS, button, message, part
from flexlab.server.visitors import (
    Context,
    context_of,
    given_twice,
    has_class,
    is_teacher,
    keep_visitor,
    known_visitor_of,
    same,
    set_cookie,
)
from flexlab.sockets import LOOPBACK, is_of_host, name_in
from flexlab.text import limited

LARGEST_BODY = 512 * 1024
"""Largest form, bytes: a study's carries its scenario, of which a measured path of the most rows takes some 320 kB."""
OPEN_TO_ALL = "/static/"
"""Style sheet and scripts need no token: they are not secret, and the sign-in page uses them."""
WITH_A_PASS = "/pass/"
"""Recordings whose address carries a pass, because rerun's viewer sends no cookies."""
COMPARISON, LIVE = "comparison/", "live/"
"""Prefixes of overlays of several runs and of labs' live data; no run's name contains a slash."""
UPLOAD = "/runs/import"
"""The only address that takes files."""
SAFE_METHODS = ("GET", "HEAD")
FORM = "application/x-www-form-urlencoded"
"""How pages send forms."""
CHARSETS = ("utf-8", "utf8", "us-ascii", "ascii")
"""Names of the encodings that the server reads as UTF-8."""

HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "SAMEORIGIN",
    # Not "no-referrer": with that, browsers send "Origin: null" with forms.
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'self'",
}
"""Sent with every answer that does not set its own."""

_HOST = re.compile(r"(\[[0-9a-fA-F:.]+\]|[\w.-]+)(?::\d{1,5})?\Z", re.ASCII)
_CONTROL = re.compile(r"[\x00-\x1f\x7f]")

log = limited(__name__)
TOO_MANY = "Too many wrong tokens came from your address: wait a few seconds, then try again."
SENTENCES = {
    400: MALFORMED,
    403: "This is not for visitors.",
    404: "There is no such page. The start page shows what there is.",
    405: "This address does not accept what was sent to it.",
}
ELSEWHERE = "This came from a page of another site."
OPENS_WITH_TOKEN = (
    "This lab opens with a token: use the whole address that you were given (the terminal shows it), "
    "or enter the token."
)
NO_COOKIE = " This browser sent no cookie: if it blocks cookies, allow them for this address."
"""Added where a browser that blocks cookies would lead around in a circle."""


async def add_headers(request: web.Request, response: web.StreamResponse) -> None:
    """Add the security headers to every answer (for `on_response_prepare`)."""
    # Not to "Not modified": a browser would replace the headers of its cached page with them.
    for name, value in HEADERS.items() if response.status != 304 else ():
        response.headers.setdefault(name, value)
    response.headers.pop(hdrs.SERVER, None)


@web.middleware
async def answer_in_sentences(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Turn every refusal and failure into a page with one sentence."""
    try:
        return await handler(request)
    except web.HTTPRequestEntityTooLarge:
        return refuse(
            request, 413, f"This form is larger than {LARGEST_BODY // 1024} kB, the most that the server takes."
        )
    except web.HTTPException as error:
        if error.status < 400:
            raise
        sentence = SENTENCES.get(error.status, f"{error.reason}.")
        return message("That did not work", sentence, error.status)
    except HttpProcessingError:
        return refuse(request, 400, MALFORMED)
    except UnicodeDecodeError:
        return refuse(request, 400, "This is not text in UTF-8: nothing was done.")
    except BusyError as error:
        return message("Not now", str(error), 503)
    except NoSuchRun as error:
        return message("No such run", str(error), 404, ALL_RUNS)
    except FlexlabError as error:
        return message("That did not work", str(error), 400)
    except ConnectionError:
        raise  # The visitor has left; nobody is there to be told.
    except Exception as error:
        if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
            return message("That did not work", SENTENCES[404], 404)
        log.exception("A page failed: %.20s %.200r", request.method, request.path)
        return message("That did not work", f"This page failed ({type(error).__name__}). The labs run on.", 500)


@web.middleware
async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Refuse requests that are malformed, come from another site's page, or lack the token."""
    context = context_of(request)
    HAS_CLASS.set(has_class(request))
    problem = _malformed(request) or _foreign(request, context)
    if problem:
        return refuse(request, *problem)
    if context.is_open or request.path.startswith(OPEN_TO_ALL) or has_pass(request):
        return await handler(request)
    if "token" in request.query and request.method in SAFE_METHODS and not is_websocket(request):
        address = network_of(request.remote or "")
        if context.guesses.is_flooding(address):
            return refuse(request, 429, TOO_MANY)
        for kind, token in (("teacher", context.settings.teacher_token), ("token", context.settings.token)):
            if token is not None and same(request.query["token"], token):
                return _sign_in(request, kind, token)
        await context.guesses.slow_down(address)
        return refuse(request, 401, "This is not the token: copy the whole address from the terminal again.")
    # Cookies hold a signature, not the token. Nobody can guess it, so a wrong one needs no delay.
    given, token = request.cookies.get(context.cookie("token"), ""), context.settings.token
    if is_teacher(request) or token is None or same(given, context.signed("token", token)):
        return await handler(request)
    log.warning("Refused %.20s %.200r from %s: no token.", request.method, request.path, request.remote)
    return ask_for_token(request)


def is_websocket(request: web.Request) -> bool:
    """Whether the browser asks for a websocket."""
    return request.headers.get(hdrs.UPGRADE, "").lower() == "websocket"


def refuse(request: web.Request, status: int, sentence: str) -> web.Response:
    """Return a page that says why the request is refused, and log the reason."""
    log.warning("Refused %.20s %.200r from %s: %.300s", request.method, request.path, request.remote, sentence)
    return message("Refused", sentence, status)


def is_opened_by_person(request: web.Request) -> bool:
    """Whether a person opened this address in a browser, rather than a page fetching it unseen (as an image, say).

    Links that change something must be followed knowingly. Programs other than browsers send no such header.
    """
    if "prefetch" in request.headers.get("Sec-Purpose", request.headers.get("Purpose", "")):
        return False
    return request.headers.get("Sec-Fetch-Dest", "document") == "document"


def is_foreign_link(request: web.Request) -> bool:
    """Whether another site's page sent the visitor here, perhaps unasked; False for programs other than browsers."""
    return request.headers.get("Sec-Fetch-Site", "none") in ("cross-site", "same-site")


def is_from_own_page(request: web.Request) -> bool:
    """Whether a page of this server sent the visitor here; False for programs other than browsers."""
    return request.headers.get("Sec-Fetch-Site", "none") == "same-origin"


def _malformed(request: web.Request) -> tuple[int, str] | None:
    path = request.path
    if ".." in path.split("/") or "\\" in path or _CONTROL.search(path):
        return 404, "There is nothing outside the server's own pages."
    if not _HOST.match(request.host) or not name_in(request.host):
        return 400, "This request names no valid host."
    if _CONTROL.search(unquote(request.rel_url.raw_query_string)):
        return 400, "This address holds control characters: copy it again."
    if twice := given_twice(request.query):
        return 400, twice
    if request.method not in SAFE_METHODS:
        if request.headers.get(hdrs.CONTENT_ENCODING, "identity").lower() != "identity":
            return 400, "The server takes no compressed requests: send it uncompressed."
        # What is read as a form without fields would empty a note.
        if request.body_exists and request.content_type != FORM and request.path != UPLOAD:
            return 400, "This was not sent as a form: nothing was done."
        if (request.charset or "utf-8").lower() not in CHARSETS:
            return 400, "The server takes text in UTF-8 only."
    return None


def _foreign(request: web.Request, context: Context) -> tuple[int, str] | None:
    """Return a status and a sentence if another site's page tries to drive the lab through a visitor's browser."""
    if context.settings.token is None and context.settings.is_local and not context.settings.is_socket:
        # A foreign name that points to 127.0.0.1 would make a foreign page look like one of ours.
        name = name_in(request.host)
        if name not in LOOPBACK:
            told = f"This lab is open to this machine only, not under the name {name}: use 127.0.0.1, or start it with a token."
            return 403, told
    return (403, ELSEWHERE) if is_from_elsewhere(request) else None


def is_from_elsewhere(request: web.Request) -> bool:
    """Whether a page of another site sent this request and it could change something."""
    if request.method in SAFE_METHODS and not is_websocket(request):
        return False
    origin = request.headers.get(hdrs.ORIGIN)
    if origin is not None and not is_of_host(origin, request.host):
        return True
    return request.headers.get("Sec-Fetch-Site", "same-origin") == "cross-site"


def _sign_in(request: web.Request, kind: str, token: str) -> web.Response:
    """Move the token from the address bar into a cookie."""
    # One slash only: an address that begins with two leads to another site.
    to = "/" + str(request.rel_url.without_query_params("token")).lstrip("/")
    if request.headers.get("Sec-Fetch-Site", "none") == "cross-site":
        # After a redirect the request would still count as cross-site, and the browser would withhold a strict cookie.
        answer = message("Welcome", "One moment.", 200, button(to, "Go on"))
        answer.headers["Refresh"] = f"0; url={to}"
    else:
        answer = web.Response(status=303, headers={hdrs.LOCATION: to})
    context = context_of(request)
    set_cookie(request, answer, context.cookie(kind), context.signed(kind, token), "Strict")
    keep_visitor(request, answer, known_visitor_of(request))
    return answer


def ask_for_token(request: web.Request, sentence: str = OPENS_WITH_TOKEN) -> web.Response:
    """Return a page on which the visitor can enter the token."""
    # The form leads to where the link would have led.
    here = request.method == "GET" and not is_websocket(request)
    query = [(name, value) for name, value in request.query.items() if here and name != "token"]
    form = part("sign_in", request.rel_url.raw_path if here else "/", query)
    return message("Sign in", sentence + ("" if request.cookies else NO_COOKIE), 401, form)


def recording_address(context: Context, run: str) -> str:
    """The address of one recording, comparison or live stream for a signed-in visitor's viewer; it opens nothing else."""
    key, place = context.pass_key, quote(run)
    if key is None:
        return f"/{place}{SUFFIX}" if run.startswith((COMPARISON, LIVE)) else f"/runs/{place}{SUFFIX}"
    return f"{WITH_A_PASS}{_pass(key, run)}/{place}{SUFFIX}"


def has_pass(request: web.Request) -> bool:
    """Whether the address of a recording carries its pass, or needs none."""
    key = context_of(request).pass_key
    if key is None:
        return True
    if not request.path.startswith(WITH_A_PASS) or request.method not in SAFE_METHODS:
        return False
    given, _, run = request.path.removeprefix(WITH_A_PASS).partition("/")
    return same(given, _pass(key, run.removesuffix(SUFFIX)))


def _pass(key: str, run: str) -> str:
    return hmac.new(key.encode(), f"recording {run}".encode(), "sha256").hexdigest()
