"""The labs of a JupyterHub for one teacher's page: each reports its state to the hub's service and follows its orders.

Labs connect to the service, not the other way round: a service that asked through the hub's proxy would start labs that nobody
opened, keep idle servers awake, and show its own key to every student's server.
"""

import asyncio
import contextlib
import itertools
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from urllib.parse import quote

import aiohttp
import msgspec
from aiohttp import WSMsgType, web

from flexlab.errors import FlexlabError
from flexlab.guide import ClassRules
from flexlab.server.labs import Choice, Lab, LabProvider, LabStatus, Request
from flexlab.server.scenario_links import decode_scenario, encode_scenario
from flexlab.sim.commands import Pause, Play

REPORTS = "/labs"
"""Path below the service's address to which labs connect."""
PERIOD = 1.0
"""Seconds between two reports."""
PATIENCE = 5.0
"""Seconds before a lab tries again to reach a service that does not answer."""
HEARTBEAT = 20.0
"""Seconds between two heartbeats: a lab that vanishes without closing its connection is dropped."""
LARGEST_REPORT = 64 * 1024
"""Largest report, bytes: it has names, numbers, and the questions that the lab has shown."""


@dataclass(frozen=True)
class Report:
    """A lab's report to the service."""

    status: LabStatus
    visitors: int


@dataclass(frozen=True)
class Order:
    """What the service asks of a lab; a field that is None or empty asks for nothing."""

    scenario: str = ""
    """The scenario as a word of `encode_scenario`."""
    name: str = ""
    playing: bool | None = None
    rules: ClassRules | None = None


async def tell_class(service: str, places: LabProvider) -> None:
    """Report this server's lab to the service at an address and follow its orders, until cancelled."""
    headers = {"Authorization": f"token {os.environ.get('JUPYTERHUB_API_TOKEN', '')}"}
    query = {"server": os.environ.get("JUPYTERHUB_SERVER_NAME", "")}
    while True:
        with contextlib.suppress(aiohttp.ClientError, OSError, ValueError):
            async with (
                aiohttp.ClientSession(headers=headers) as session,
                session.ws_connect(service.rstrip("/") + REPORTS, params=query, heartbeat=HEARTBEAT) as plug,
            ):
                telling = asyncio.create_task(_report(plug, places))
                try:
                    async for said in plug:
                        if said.type is not WSMsgType.TEXT:  # The line is broken, which comes as a message too.
                            break
                        await _follow(places, msgspec.json.decode(said.data, type=Order))
                finally:
                    telling.cancel()
        await asyncio.sleep(PATIENCE)


async def _report(plug: aiohttp.ClientWebSocketResponse, places: LabProvider) -> None:
    while True:
        [place] = places.running()
        status = replace(place.status(), recording=None, link="")
        if not math.isfinite(status.error):  # JSON has no such number; the state says that the run failed.
            status = replace(status, error=0.0)
        await plug.send_str(msgspec.json.encode(Report(status, place.visitors)).decode())
        await asyncio.sleep(PERIOD)


async def _follow(places: LabProvider, order: Order) -> None:
    [place] = places.running()
    if order.rules is not None:
        await places.rule(order.rules)
    if order.playing is not None:
        await place.ask(Play() if order.playing else Pause())
    with contextlib.suppress(FlexlabError):  # A scenario of a later version.
        if order.scenario:
            await place.ask(Choice(await asyncio.to_thread(decode_scenario, order.scenario), order.name))


class HubLab(Lab):
    """A student's lab, known by its reports."""

    def __init__(self, number: int, name: str, server: str, plug: web.WebSocketResponse):
        self.number, self.name = number, name
        # Relative to the service at /services/NAME: the lab behind the student's own server.
        own = "/".join(quote(word, safe="") for word in (name, server) if word)
        self.path = f"/../../user/{own}/flexlab/lab"
        self._plug = plug
        self._status = LabStatus("", "", 0.0, "starting", "", None, "")

    async def follow_reports(self) -> None:
        """Take its reports until it disconnects or sends something else."""
        with contextlib.suppress(msgspec.MsgspecError):
            async for said in self._plug:
                if said.type is not WSMsgType.TEXT:
                    break
                report = msgspec.json.decode(said.data, type=Report)
                self._status, self.visitors = report.status, report.visitors

    async def ask(self, what: Request) -> None:
        """Pass a request on to the lab, unless it is disconnecting."""
        if isinstance(what, Choice):
            order = Order(await asyncio.to_thread(encode_scenario, what.scenario), what.name)
        else:
            order = Order(rules=what) if isinstance(what, ClassRules) else Order(playing=isinstance(what, Play))
        with contextlib.suppress(ConnectionError):
            await self._plug.send_str(msgspec.json.encode(order).decode())


class HubLabs(LabProvider):
    """All labs that report to this service."""

    is_private = True

    def __init__(self) -> None:
        super().__init__()
        self._labs: dict[str, HubLab] = {}
        self._numbers = itertools.count(1)

    async def take_reports(self, request: web.Request, name: str) -> web.WebSocketResponse:
        """List a student's lab for as long as it is connected."""
        plug = web.WebSocketResponse(heartbeat=HEARTBEAT, max_msg_size=LARGEST_REPORT)
        await plug.prepare(request)
        lab = HubLab(next(self._numbers), name, request.query.get("server", ""), plug)
        self._labs[lab.path] = lab
        try:
            await lab.ask(self.rules)  # It may come back with earlier ones.
            await lab.follow_reports()
        finally:
            if self._labs.get(lab.path) is lab:
                del self._labs[lab.path]
        await plug.close()
        return plug

    def running(self) -> Sequence[Lab]:
        """All labs, by name."""
        return sorted(self._labs.values(), key=lambda lab: lab.path)
