"""A lab on a Unix socket below a base URL, behind a proxy, as on a JupyterHub: none of its addresses leads out of it."""

import asyncio
import re
import stat
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import parse_qs, urljoin, urlsplit

import aiohttp
import pytest
import viser
from aiohttp import web

from flexlab.errors import LabError
from flexlab.jupyter import lab_server
from flexlab.presets import load_preset
from flexlab.server.front_server import STATIC, FrontServer
from flexlab.server.scenario_links import encode_scenario
from flexlab.server.settings import Settings

BASE = "/user/ann/flexlab"
ADDRESSES = re.compile(r'(?:href|src|action|formaction|data-address|data-cells|data-recording|data-state)="([^"]*)"')
HUB = {"Host": "hub.example"}
PATIENCE = aiohttp.ClientTimeout(total=30)
OF_A_HOP = {"Transfer-Encoding", "Content-Length", "Connection", "Keep-Alive", "Set-Cookie"}
"""Headers that the proxy does not copy but sets itself."""
PAGES = ("/", "/runs", "/studies", "/leaderboard", "/lab/", "/teacher", "/nothing")
SWEEP = {
    "scenario": encode_scenario(load_preset("paper")), "name": "paper", "kind": "sweep", "duration": "0.05",
    "field1": "payload.bending_stiffness", "low1": "50", "high1": "100", "count1": "2", "field2": "",
}  # fmt: skip
ROOTED = re.compile(r"""(?<![$*]=)["'`]/\w""")
"""The start of an address from the root in a script, outside of selectors such as `[src*="/assets/"]`."""


def reverse_proxy(socket: Path, takes_off: bool) -> web.Application:
    """A proxy that serves the lab below BASE only, and passes the prefix on or removes it."""

    async def passed(request: web.Request) -> web.StreamResponse:
        if not request.path.startswith(BASE):
            raise web.HTTPTeapot(reason="This leads out of the lab")
        path = request.rel_url.raw_path.removeprefix(BASE) if takes_off else request.rel_url.raw_path
        url = f"http://{request.host}{path or '/'}" + (f"?{request.query_string}" if request.query_string else "")
        async with aiohttp.ClientSession(connector=aiohttp.UnixConnector(str(socket)), auto_decompress=False) as inside:
            if request.headers.get("Upgrade", "").lower() == "websocket":
                words = request.headers.get("Sec-WebSocket-Protocol", "").split(", ")
                async with inside.ws_connect(url, protocols=words) as up:
                    down = web.WebSocketResponse(protocols=[up.protocol] if up.protocol else ())
                    await down.prepare(request)
                    await down.send_bytes((await up.receive()).data)
                    await down.close()
                    return down
            body = await request.read()
            async with inside.request(
                request.method, url, headers=request.headers, data=body, allow_redirects=False
            ) as answer:
                kept = {name: value for name, value in answer.headers.items() if name not in OF_A_HOP}
                cookies = answer.headers.getall("Set-Cookie", [])
                passed_on = web.Response(body=await answer.read(), status=answer.status, headers=kept)
                for cookie in cookies:
                    passed_on.headers.add("Set-Cookie", cookie)
                return passed_on

    app = web.Application()
    app.router.add_route("*", "/{path:.*}", passed)
    return app


@pytest.mark.parametrize("takes_off", [True, False])
def test_every_address_stays_below_the_base(
    open_another: Callable[..., FrontServer], recorded: Path, tmp_path: Path, takes_off: bool
):
    logs, socket = tmp_path / "logs", tmp_path / "lab.sock"
    logs.mkdir()
    for file in (recorded, recorded.with_suffix(".json")):
        (logs / file.name).write_bytes(file.read_bytes())
    opened = open_another(host=f"unix:{socket}", base_url=BASE + "/", rerun=True)
    assert stat.S_IMODE(socket.stat().st_mode) == 0o600, "nobody else on this machine may come in"
    assert str(socket) in opened.url
    with ThreadPoolExecutor(1) as apart:  # Playwright keeps an event loop on this thread.
        apart.submit(asyncio.run, look_around(reverse_proxy(socket, takes_off), recorded.stem)).result()


async def look_around(proxy: web.Application, run: str) -> None:
    runner = web.AppRunner(proxy, shutdown_timeout=0.5)
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    root = f"http://127.0.0.1:{runner.addresses[0][1]}"
    jar = aiohttp.CookieJar(unsafe=True)
    try:
        # A hub has a host name of its own, not one of loopback.
        async with aiohttp.ClientSession(root, cookie_jar=jar, headers=HUB, timeout=PATIENCE) as browser:
            async with browser.post(f"{BASE}/studies", data=SWEEP, allow_redirects=False) as answer:
                study = answer.headers["Location"]
                assert (answer.status, study.startswith(f"{BASE}/studies/")) == (303, True)
            found = {study, *(BASE + page for page in (*PAGES, f"/runs/{run}"))}
            for page in sorted(found):
                async with browser.get(page) as answer:
                    assert answer.status == (404 if page.endswith("/nothing") else 200), page
                    found |= {urljoin(page, address) for address in ADDRESSES.findall(await answer.text())}
                    assert all(cookie["path"] == f"{BASE}/" for cookie in answer.cookies.values())
            addresses = {address for address in found if not address.startswith(("data:", "#", "http"))}
            assert {urlsplit(address).path.startswith(f"{BASE}/") for address in addresses} == {True}, addresses
            assert len(addresses) > 40
            assert f"{study}/cells/" in addresses, "the cells of a study's map are links, too"
            for address in (address for address in addresses if "/static/" in address or address.endswith(".rrd")):
                async with browser.get(address) as answer:
                    assert answer.status == 200, address
            for script in STATIC.glob("*.js"):
                async with browser.get(f"{BASE}/static/{script.name}") as answer:
                    assert answer.status == 200, script.name
                    text = (await answer.text()).replace('link("/', "")  # `link` adds the base.
                    assert ROOTED.findall(text) == [], script.name
            async with browser.post(f"{BASE}/name", data={"name": "Ann"}, allow_redirects=False) as answer:
                assert (answer.status, answer.headers["Location"]) == (303, f"{BASE}/")
            jupyter = {"X-Forwarded-Context": BASE}
            async with browser.post(
                f"{BASE}/runs/{run}/notes", data={"note": "kept"}, allow_redirects=False, headers=jupyter
            ) as answer:
                assert answer.status == 303
                assert not answer.headers["Location"].startswith("/"), "it would put the base before it once more"
                assert urljoin(f"{BASE}/runs/{run}/notes", answer.headers["Location"]) == f"{BASE}/runs/{run}"
            async with browser.get(
                f"{BASE}/live", allow_redirects=False, headers={"X-Forwarded-Proto": "https"}
            ) as answer:
                source = parse_qs(urlsplit(answer.headers["Location"]).query)["url"][0]
                assert source.startswith(f"https://hub.example{BASE}/")
            async with browser.get(f"{BASE}/state/lab") as answer:
                assert (await answer.json())["open"]
            protocol = f"viser-v{viser.__version__}"
            async with browser.ws_connect(f"{BASE}/lab/", protocols=[protocol]) as lab:
                assert lab.protocol == protocol
                assert (await lab.receive()).type is aiohttp.WSMsgType.BINARY
    finally:
        await runner.cleanup()


@pytest.mark.parametrize("base", ["user", "/a b", "//evil", "/a/../b", '/"onload="', "/a?b", "/é", "http://x"])
def test_an_invalid_base_url_is_refused(base: str):
    with pytest.raises(LabError, match="is not a valid prefix of an address: write one like /user/ann/flexlab"):
        Settings(base_url=base)


def test_a_socket_refuses_private_labs_and_a_second_server(open_another: Callable[..., FrontServer], tmp_path: Path):
    with pytest.raises(LabError, match="leave out --private"):
        Settings(host="unix:x", private=True)
    (tmp_path / "file").write_text("mine")
    for path, says in ((tmp_path / "no" / "s", "choose a short path"), ("x" * 200, "choose a short path")):
        with pytest.raises(LabError, match=says):
            open_another(host=f"unix:{path}")
    open_another(host=f"unix:{tmp_path / 's'}")
    with pytest.raises(LabError, match="is in use by another program"):
        open_another(host=f"unix:{tmp_path / 's'}")


def test_the_launcher_starts_a_lab_on_a_socket_with_logs_in_the_home_folder():
    about = lab_server()
    words = about["command"]
    assert words[words.index("--host") + 1] == "unix:{unix_socket}"
    assert words[words.index("--logs") + 1] == str(Path.home() / "flexlab" / "logs")
    assert Path(about["launcher_entry"]["icon_path"]).is_file()
