"""The teacher's page of a class on a JupyterHub, as a service that the hub starts: `python -m flexlab.server.hub_service`.

The hub identifies people: students' labs send their servers' tokens, and teachers sign in by OAuth as everywhere on a hub.
The service needs no rights over the hub. See .github/UNIVERSITY.md.
"""

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode, urlsplit

import aiohttp
from aiohttp import hdrs, web

from flexlab.errors import LabError
from flexlab.server.auth import ELSEWHERE, is_from_elsewhere, refuse
from flexlab.server.connections import Handler
from flexlab.server.front_server import FrontServer, build_app
from flexlab.server.labs.hub_labs import REPORTS, HubLabs
from flexlab.server.limits import BusyError
from flexlab.server.pages import OF_HUB, teacher_page
from flexlab.server.settings import Settings, secret_word
from flexlab.server.visitors import Context, context_of, scheme_of, set_cookie
from flexlab.sockets import listen

CALLBACK = "/oauth_callback"
LOOK = 60.0
"""Seconds after which the hub is asked again about a signed-in teacher, so that a log-out there soon takes effect here."""
MOST_STATES = 1000
"""Most sign-ins under way at once."""
SESSION, STATE = "flexlab-hub-session", "flexlab-hub-state"
"""Cookies of a signed-in teacher, and of a sign-in under way."""


@dataclass
class Session:
    """A signed-in teacher."""

    token: str
    asked: float
    """When the hub last confirmed the teacher, by the clock of `time.monotonic`, s."""


class Hub:
    """The hub that started this service, as the environment variables describe it."""

    def __init__(self, environment: Mapping[str, str]):
        try:
            self._token, self._api = environment["JUPYTERHUB_API_TOKEN"], environment["JUPYTERHUB_API_URL"]
            self._client = environment["JUPYTERHUB_CLIENT_ID"]
            self.url = urlsplit(environment["JUPYTERHUB_SERVICE_URL"])
            self.prefix = environment["JUPYTERHUB_SERVICE_PREFIX"].rstrip("/")
            self._scopes = set(json.loads(environment["JUPYTERHUB_OAUTH_ACCESS_SCOPES"]))
            self._hub = environment.get("JUPYTERHUB_HOST", "") + environment["JUPYTERHUB_BASE_URL"] + "hub/"
        except KeyError as error:
            raise LabError(
                f"{error.args[0]} is not set: a JupyterHub starts this service, see UNIVERSITY.md."
            ) from None
        self._sessions: dict[str, Session] = {}
        self._states: dict[str, None] = {}

    async def who(self, inside: aiohttp.ClientSession, token: str) -> dict[str, Any]:
        """Ask the hub which user owns a token; empty if there is none. Raises `BusyError` if the hub does not answer."""
        return await self._ask(inside, "GET", "user", headers={"Authorization": f"token {token}"})

    async def _ask(self, inside: aiohttp.ClientSession, method: str, what: str, **more: Any) -> dict[str, Any]:
        """The hub's answer; empty if it refuses. Raises `BusyError`."""
        try:
            async with inside.request(method, f"{self._api}/{what}", **more) as answer:
                return await answer.json() if answer.status == 200 else {}
        except (aiohttp.ClientError, TimeoutError):
            raise BusyError("The hub does not answer: try again in a moment.") from None

    def may_teach(self, user: dict[str, Any]) -> bool:
        """Whether the hub's administrator lets a user use this service."""
        return not self._scopes.isdisjoint(user.get("scopes", ()))

    async def is_signed_in(self, request: web.Request) -> bool:
        """Whether the request comes from a signed-in teacher."""
        word = request.cookies.get(SESSION, "")
        session = self._sessions.get(word)
        if session is None:
            return False
        if time.monotonic() - session.asked > LOOK:
            if not self.may_teach(await self.who(context_of(request).inside, session.token)):
                self._sessions.pop(word, None)
                return False
            session.asked = time.monotonic()
        return True

    def sign_in(self, request: web.Request) -> web.Response:
        """Redirect to the hub, which sends the user back with a code."""
        state = secret_word()
        self._states[state] = None
        while len(self._states) > MOST_STATES:
            del self._states[next(iter(self._states))]
        words = {
            "client_id": self._client,
            "redirect_uri": self.prefix + CALLBACK,
            "response_type": "code",
            "state": state,
        }
        # The full address: one that begins with a slash would be an address of this service.
        hub = self._hub if "://" in self._hub else f"{scheme_of(request)}://{request.host}{self._hub}"
        answer = web.Response(status=302, headers={hdrs.LOCATION: f"{hub}api/oauth2/authorize?{urlencode(words)}"})
        set_cookie(request, answer, STATE, state, age=None)
        return answer

    async def finish_sign_in(self, request: web.Request) -> web.Response:
        """Exchange the hub's code for a token, which stays on this server."""
        state = request.query.get("state", "")
        if state not in self._states or state != request.cookies.get(STATE):
            return refuse(request, 403, "This sign-in was not begun here, or too long ago: open the page again.")
        del self._states[state]
        inside = context_of(request).inside
        words = {
            "client_id": self._client,
            "client_secret": self._token,
            "grant_type": "authorization_code",
            "code": request.query.get("code", ""),
            "redirect_uri": self.prefix + CALLBACK,
        }
        token = (await self._ask(inside, "POST", "oauth2/token", data=words)).get("access_token", "")
        if not self.may_teach(await self.who(inside, token)):
            return refuse(request, 403, "The hub does not let you use this page: ask its administrator.")
        word = secret_word()
        self._sessions[word] = Session(token, time.monotonic())
        answer = web.Response(status=303, headers={hdrs.LOCATION: "/teacher"})
        set_cookie(request, answer, SESSION, word, age=None)
        return answer


def hub_app(hub: Hub, context: Context) -> web.Application:
    """The web application of the service."""

    @web.middleware
    async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
        OF_HUB.set(True)
        if request.path.startswith("/static/") or request.path in (REPORTS, CALLBACK):
            return await handler(request)
        if is_from_elsewhere(request):
            return refuse(request, 403, ELSEWHERE)
        if await hub.is_signed_in(request):
            return await handler(request)
        return (
            hub.sign_in(request) if request.method == "GET" else refuse(request, 403, "Sign in: open the page again.")
        )

    async def first_page(request: web.Request) -> web.StreamResponse:
        raise web.HTTPSeeOther("/teacher")

    async def reports(request: web.Request) -> web.StreamResponse:
        token = request.headers.get(hdrs.AUTHORIZATION, "").removeprefix("token ")
        name = (await hub.who(context.inside, token)).get("name")
        if not name:
            return refuse(request, 403, "Labs report here, with the tokens of their servers.")
        assert isinstance(context.places, HubLabs)
        return await context.places.take_reports(request, str(name))

    own = [web.get("/", first_page), web.get(REPORTS, reports), web.get(CALLBACK, hub.finish_sign_in)]
    return build_app(context, check, [*own, *teacher_page.ROUTES])


def open_hub_service(environment: Mapping[str, str]) -> FrontServer:
    """Open the service for the hub that an environment describes. Raises `LabError`."""
    hub = Hub(environment)
    host, port = hub.url.hostname or "127.0.0.1", hub.url.port or 80
    settings = Settings(host=host, port=port, base_url=hub.prefix, is_hub_service=True)
    return FrontServer(settings, HubLabs(), listen(host, port), lambda context: hub_app(hub, context))


def main() -> None:
    """Serve until the hub ends the process."""
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, frame: ended.set())
    try:
        service = open_hub_service(os.environ)
    except LabError as error:
        sys.exit(str(error))
    with service:
        ended.wait()


if __name__ == "__main__":
    main()
