"""Pages show their content at a second visit too, when a browser asks whether the copy that it kept is still valid."""

import re
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from urllib.parse import urlsplit

import pytest
from browser_window import UNDRAWN, open_window
from http_client import PATIENCE, ask, compared, over, post
from person import open_server
from playwright.sync_api import Browser, Locator

from flexlab.presets import load_preset, preset_names
from flexlab.server.auth import HEADERS
from flexlab.server.front_server import FrontServer, build_app
from flexlab.server.scenario_links import encode_scenario

NEVER_SINCE = "Fri, 01 Jan 2038 00:00:00 GMT"
SWEEP = {
    "scenario": encode_scenario(load_preset("paper")), "name": "paper", "kind": "sweep", "duration": "0.05",
    "field1": "payload.bending_stiffness", "low1": "50", "high1": "100", "count1": "2", "field2": "",
}  # fmt: skip
LAB = """() => window.__viserMutable?.nodeRefFromName?.['/beam'] != null
  && document.body.innerText.includes('Bending stiffness')"""
VIEWER = "() => document.getElementById('viewer')?.contentDocument?.querySelector('canvas') != null"
SHOWS = {
    r"/": "() => document.querySelectorAll('.card').length > 10",
    r"/lab/": LAB,
    r"/runs": "() => document.querySelectorAll('#runs tbody tr').length > 1",
    r"/runs/delete": "() => document.querySelector('main form button') != null",
    r"/runs/[^/]+": VIEWER,
    r"/compare": VIEWER,
    r"/studies": "() => document.querySelector('main form select') != null",
    r"/studies/[\w-]+": "() => document.querySelectorAll('a.cell').length === 2",
    r"/leaderboard": "() => document.querySelector('main form button') != null",
    r"/teacher": "() => document.querySelector('#labs > *') != null",
}
"""Pattern of a page's path → script that says whether its content is there; the first pattern that fits counts."""

LINKS = """() => [...document.querySelectorAll("#server-bar a[href^='/'], header a, main a[href^='/']")]
  .filter((link) => link.offsetParent && !link.hasAttribute('download')).map((link) => link.getAttribute('href'))"""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory, recorded: Path, few_pictures: None) -> Iterator[FrontServer]:
    """A server with two recordings."""
    logs = tmp_path_factory.mktemp("visited")
    for name in ("2025-12-30T12-00-00-one", "2025-12-31T12-00-00-two"):
        (logs / f"{name}.rrd").write_bytes(recorded.read_bytes())
    with open_server(logs) as opened:
        yield opened


@pytest.fixture(scope="module")
def study(server: FrontServer) -> str:
    """The address of a finished sweep of two cells."""
    address = post(server.url, "/studies", SWEEP).headers["Location"]
    over(server.url, f"{address}/state", 4 * PATIENCE)
    return address


def test_an_answer_not_modified_changes_no_header_of_the_kept_copy(server: FrontServer, study: str):
    run = "/runs/2025-12-30T12-00-00-one"
    comparison = "/compare?run=2025-12-30T12-00-00-one&run=2025-12-31T12-00-00-two"
    place, shown = compared(server.url, "2025-12-30T12-00-00-one", "2025-12-31T12-00-00-two")
    overlay = re.findall(r'data-recording="([^"]+)"', shown.text)[0]
    asked_again = [
        "/lab/", "/static/style.css", "/favicon.ico", "/assets/pictures/paper.svg", "/viewer/re_viewer.js",
        f"{run}.rrd", f"/pass/any{run.removeprefix('/runs')}.rrd", overlay, f"/pass/any{overlay}", f"{study}/cells.parquet",
    ]  # fmt: skip
    others = [
        "/", "/lab", "/lab/paper", "/lab/paper/", "/s/none", "/s/none/", "/state/lab", "/state/s/none", "/live",
        "/live/lab.rrd", "/pass/any/live/lab.rrd", comparison, place,
        f"/compare/{place.rpartition('of=')[2]}/state", "/leaderboard", "/leaderboard/state", "/leaderboard/none/B1.svg",
        "/teacher", "/teacher/labs", "/runs", "/runs/", run, f"{run}/replay", f"{run}/export?format=csv",
        f"/runs/delete?run={run.rpartition('/')[2]}",
        "/viewer/", "/studies", study, f"{study}/state", f"{study}/data", f"{study}/cells/0",
    ]  # fmt: skip
    kept: list[str] = []
    for address in asked_again + others:
        first = ask(server.url, address)
        again = ask(server.url, address, If_None_Match=first.headers["ETag"] or "*", If_Modified_Since=NEVER_SINCE)
        if again.status == 304:
            kept.append(address)
            changed = {
                name: again.headers[name] for name in HEADERS if again.headers[name] not in (None, first.headers[name])
            }
            assert changed == {}, address
    assert kept == asked_again
    visited = [urlsplit(address).path for address in asked_again + others]
    app = build_app(cast(Any, SimpleNamespace(settings=server.settings)))
    routes = [route.resource for route in app.router.routes() if route.method == "GET"]
    infos = [resource.get_info() for resource in routes if resource is not None]
    patterns = [re.escape(info["path"]) if "path" in info else info.get("pattern") for info in infos]
    unvisited = [p for p in patterns if p is not None and not any(re.fullmatch(p, path) for path in visited)]
    assert unvisited == [], "each route is asked"


def test_every_page_shows_its_content_at_each_visit(plain_chromium: Browser, server: FrontServer, study: str):
    context = open_window(plain_chromium, 1280, 800)
    context.add_init_script(UNDRAWN)
    page = context.new_page()
    broken: list[str] = []
    page.on("pageerror", lambda error: broken.append(str(error)))
    met: list[set[str]] = []
    led: set[str] = set()

    def shown() -> None:
        path = urlsplit(page.url).path
        kind = next((pattern for pattern in SHOWS if re.fullmatch(pattern, path)), None)
        assert kind is not None, f"{page.url} is no page that was looked for"
        page.wait_for_function(SHOWS[kind])
        met[-1].add(kind)
        led.update(urlsplit(to).path for to in page.evaluate(LINKS))

    def follow(link: Locator) -> None:
        before = page.url
        link.first.click()
        page.wait_for_url(lambda url: url != before)
        shown()

    def named(name: str) -> Locator:
        return page.get_by_role("link", name=name, exact=True)

    for visit in range(2):
        met.append(set())
        page.goto(server.url)
        shown()
        if visit == 0:  # The second time it is opened by a cell of a study, below.
            follow(named("Open the lab"))
        follow(named("Runs"))
        for box in page.locator("#runs tbody input[type=checkbox]").all()[-2:]:
            box.check()
        follow(page.get_by_role("button", name="Compare"))
        follow(page.locator(".compared a"))
        follow(named("Studies"))
        follow(page.locator(f"main a[href='{study}']"))
        if visit == 1:
            follow(page.locator("a.cell[data-cell='1']"))
            page.reload()
            shown()
        follow(named("Studies"))
        follow(named("Leaderboard of control laws"))
        page.goto(f"{server.url}teacher")
        shown()
        follow(named("Runs"))
        follow(page.locator("#runs a[href='/runs/delete?run=2025-12-31T12-00-00-two']"))
        follow(named("Keep it"))
        follow(named("flexlab"))
    context.close()
    assert broken == []
    assert met == [set(SHOWS)] * 2
    unmet = {path for path in led if not any(re.fullmatch(kind, path) for kind in SHOWS)}
    assert unmet == {f"/lab/{name}" for name in preset_names()}, "these lead into the lab, as the studies' cells do"
