"""The teacher's page of a JupyterHub: a real lab reports to the real service, and a stand-in for the hub names the users.

The real hub is in tests/peers/jupyter_hub.py.
"""

import asyncio
import json
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlencode, urlsplit

import msgspec
import pytest
from aiohttp import web
from aiohttp.test_utils import TestServer
from http_client import PATIENCE, Answer, ask, post, run_apart, wait_until
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from flexlab.errors import LabError
from flexlab.guide import ClassRules
from flexlab.presets import load_preset
from flexlab.server import connections
from flexlab.server.front_server import FrontServer
from flexlab.server.hub_service import SESSION, STATE, main, open_hub_service
from flexlab.server.labs import LabStatus, hub_labs
from flexlab.server.labs.hub_labs import HubLabs
from flexlab.sockets import free_ports

PREFIX = "/services/flexlab"
SCOPES = {"teacher": ["access:services!service=flexlab"], "ann": ["access:servers!server=ann/"]}


class StandIn(BaseHTTPRequestHandler):
    """A hub in which a user's name is also their token and their OAuth code."""

    def do_GET(self) -> None:
        name = self.headers.get("Authorization", "").removeprefix("token ")
        self._say(200 if name in SCOPES else 403, {"name": name, "scopes": SCOPES.get(name, [])})

    def do_POST(self) -> None:
        words = parse_qs(self.rfile.read(int(self.headers["Content-Length"])).decode())
        right = (words["client_id"], words["client_secret"]) == (["service-flexlab"], ["secret"])
        self._say(200 if right else 403, {"access_token": words["code"][0]})

    def _say(self, status: int, what: object) -> None:
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.end_headers()
        self.wfile.write(json.dumps(what).encode())

    def log_message(self, format: str, *args: object) -> None:
        """Nobody needs a line per request."""


def environment_of(hub: int, port: int) -> dict[str, str]:
    """The environment in which a hub, given by its port, starts the service on a port."""
    return {
        "JUPYTERHUB_API_TOKEN": "secret",
        "JUPYTERHUB_API_URL": f"http://127.0.0.1:{hub}/hub/api",
        "JUPYTERHUB_CLIENT_ID": "service-flexlab",
        "JUPYTERHUB_SERVICE_URL": f"http://127.0.0.1:{port}",
        "JUPYTERHUB_SERVICE_PREFIX": f"{PREFIX}/",
        "JUPYTERHUB_OAUTH_ACCESS_SCOPES": '["access:services", "access:services!service=flexlab"]',
        "JUPYTERHUB_BASE_URL": "/",
    }


@pytest.fixture
def service() -> Iterator[FrontServer]:
    with ThreadingHTTPServer(("127.0.0.1", 0), StandIn) as hub:
        threading.Thread(target=hub.serve_forever, args=(0.05,), daemon=True).start()
        with open_hub_service(environment_of(hub.server_port, *free_ports(1))) as opened:
            yield opened
        hub.shutdown()


def sign_in(service: FrontServer, name: str) -> Answer:
    """Sign in through the hub under a name and return the service's answer."""
    first = ask(service.url, f"{PREFIX}/teacher")
    to = urlsplit(first.headers["Location"])
    assert (first.status, to.path) == (302, "/hub/api/oauth2/authorize")
    words = parse_qs(to.query)
    assert words["redirect_uri"] == [f"{PREFIX}/oauth_callback"]
    back = urlencode({"state": words["state"][0], "code": name})
    return ask(service.url, f"{PREFIX}/oauth_callback?{back}", cookies=first.cookies)


def test_a_teacher_sees_and_leads_the_labs_that_report(
    service: FrontServer,
    open_another: Callable[..., FrontServer],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(
        connections, "HEAD_TIME", 0.5
    )  # s: a lab's connection lasts longer, and must not count as a slow request.
    (tmp_path / "hub").mkdir()
    monkeypatch.chdir(tmp_path / "hub")
    answer = sign_in(service, "teacher")
    assert (answer.status, answer.headers["Location"]) == (303, f"{PREFIX}/teacher")
    mine = {SESSION: answer.cookies[SESSION]}

    def labs() -> list[dict]:
        return json.loads(ask(service.url, f"{PREFIX}/teacher/labs", cookies=mine).body)["labs"]

    def order(what: str, **form: str) -> str:
        told = post(service.url, f"{PREFIX}/teacher/{what}", form, mine, Accept="application/json")
        return json.loads(told.body)["sentence"]

    page = ask(service.url, f"{PREFIX}/teacher", cookies=mine).text
    assert f'src="{PREFIX}/static/teacher.js"' in page
    assert ">Runs<" not in page, "a hub's service has no runs"
    assert labs() == []
    assert "nobody can play" in order("rules", lock="on")
    monkeypatch.setenv("JUPYTERHUB_API_TOKEN", "ann")
    lab = open_another(
        host=f"unix:{tmp_path / 's'}",
        base_url="/user/ann/flexlab",
        class_service=f"http://127.0.0.1:{service.port}{PREFIX}/",
    )
    [place] = lab.places.running()
    wait_until(lambda: lab.places.rules.locked, "who comes later follows, too")
    order("rules")
    wait_until(lambda: not lab.places.rules.locked, "the lock is gone")
    wait_until(lambda: [(told["who"], told["preset"]) for told in labs()] == [("ann", "paper")], "her lab is shown")
    [told], [seen] = labs(), service.places.running()
    assert told["lab"] == "/../../user/ann/flexlab/lab", "beside the service, whatever comes before both"
    assert "was sent to 1 lab" in order("send", preset="soft-beam", lab=told["lab"])
    wait_until(lambda: place.status().name == "soft-beam", "the preset comes")
    assert place.status().title == load_preset("soft-beam").title
    wait_until(lambda: labs()[0]["preset"] == "soft-beam", "and is told")
    assert order("pause") == "1 lab paused."
    wait_until(lambda: place.status().state == "paused", "it stands")
    assert service.places.running() == [seen], "it has been the same connection all the time"
    order("rules", lock="on")
    wait_until(lambda: lab.places.rules.locked, "the class is locked once more")
    service.places.rules = (
        ClassRules()
    )  # As a service has that the hub starts anew, or that unlocked while the line was broken.
    monkeypatch.setattr(hub_labs, "PATIENCE", 0.0)
    asyncio.run_coroutine_threadsafe(seen._plug.close(), service._loop).result()
    wait_until(lambda: not lab.places.rules.locked, "a lab that comes back follows the rules in force")
    lab.close()
    wait_until(lambda: labs() == [], "what is closed is gone")
    assert not [*Path().iterdir()], "rules that no later service takes up are not saved"


def test_only_a_teacher_can_use_the_service(service: FrontServer):
    assert sign_in(service, "ann").status == 403
    assert ask(service.url, f"{PREFIX}/oauth_callback?state=x&code=teacher", cookies={STATE: "x"}).status == 403
    assert ask(service.url, f"{PREFIX}/teacher/labs", cookies={SESSION: "x"}).status == 302
    assert ask(service.url, f"{PREFIX}/teacher/pause", "POST", b"").status == 403
    mine = {SESSION: sign_in(service, "teacher").cookies[SESSION]}
    elsewhere = ask(service.url, f"{PREFIX}/teacher/pause", "POST", b"", mine, Origin="http://evil.example")
    assert elsewhere.status == 403
    assert ask(service.url, f"{PREFIX}/labs", Authorization="token eve").status == 403


@pytest.mark.parametrize("said", ["nonsense", "{}", '{"status": {"error": NaN}, "visitors": 1}', "x" * 100_000])
def test_a_lab_that_sends_an_invalid_report_is_disconnected(
    service: FrontServer, said: str, caplog: pytest.LogCaptureFixture
):
    address = f"ws://127.0.0.1:{service.port}{PREFIX}/labs"
    with connect(address, additional_headers={"Authorization": "token ann"}) as lab:
        assert "rules" in json.loads(lab.recv(timeout=30)), "the rules in force come first"
        lab.send(said)
        with pytest.raises(ConnectionClosed):
            lab.recv(timeout=30)
    wait_until(lambda: not service.places.running(), "it is no longer listed")
    assert not [record for record in caplog.records if record.exc_info]


def test_a_lab_that_reports_impossible_numbers_does_not_blank_the_teacher_s_page(service: FrontServer):
    mine = {SESSION: sign_in(service, "teacher").cookies[SESSION]}
    address = f"ws://127.0.0.1:{service.port}{PREFIX}/labs"
    status = LabStatus("paper", "Paper", 1e308, "running", "", None, "", error=1e308)
    with connect(address, additional_headers={"Authorization": "token ann"}) as lab:
        lab.send(msgspec.json.encode(hub_labs.Report(status, 1)).decode())
        wait_until(lambda: [place.status() for place in service.places.running()] == [status], "it has reported")
        told = ask(service.url, f"{PREFIX}/teacher/labs", cookies=mine).text
    assert json.loads(told, parse_constant=pytest.fail)["labs"][0]["error"] is None, "Infinity is not JSON"


def test_a_lab_whose_line_broke_reports_again(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(hub_labs, "HEARTBEAT", 0.2)
    monkeypatch.setattr(hub_labs, "PATIENCE", 0.0)

    async def reports() -> list[str]:
        came: list[str] = []
        again = asyncio.Event()

        async def service(request: web.Request) -> web.WebSocketResponse:
            plug = web.WebSocketResponse(autoping=False)
            await plug.prepare(request)
            came.append("a lab")
            if len(came) > 1:
                again.set()
            await again.wait()  # The first line brings no answer to a ping.
            return plug

        app = web.Application()
        app.router.add_get(hub_labs.REPORTS, service)
        async with TestServer(app) as server:
            telling = asyncio.create_task(hub_labs.tell_class(str(server.make_url("/")), HubLabs()))
            waiting = asyncio.create_task(again.wait())
            await asyncio.wait([telling, waiting], timeout=PATIENCE, return_when=asyncio.FIRST_COMPLETED)
            for task in (telling, waiting):
                task.cancel()
            again.set()
        return came

    assert run_apart(reports())[:2] == ["a lab", "a lab"]


def test_a_hub_that_does_not_answer_is_said_not_to(caplog: pytest.LogCaptureFixture):
    nobody, port = free_ports(2)
    with open_hub_service(environment_of(nobody, port)) as service:
        begun = parse_qs(urlsplit(ask(service.url, f"{PREFIX}/teacher").headers["Location"]).query)["state"][0]
        back = ask(service.url, f"{PREFIX}/oauth_callback?state={begun}&code=teacher", cookies={STATE: begun})
        reported = ask(service.url, f"{PREFIX}/labs", Authorization="token ann")
        for answer in (back, reported):
            assert (answer.status, "The hub does not answer" in answer.text) == (503, True)
    assert not [record for record in caplog.records if record.exc_info]


def test_without_a_hub_the_service_says_so(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(LabError, match="JUPYTERHUB_API_TOKEN is not set: a JupyterHub starts this service"):
        open_hub_service({})
    monkeypatch.delenv("JUPYTERHUB_API_TOKEN", raising=False)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    with pytest.raises(SystemExit, match="JUPYTERHUB_API_TOKEN is not set"):
        main()
