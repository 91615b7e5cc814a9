"""The leaderboard's page: the newest table, and the state of a computation under way."""

import json
from collections.abc import Callable
from dataclasses import replace

from http_client import ask, over

from flexlab.analysis.leaderboard.board import make_tasks, run_board
from flexlab.analysis.leaderboard.case import cases
from flexlab.analysis.leaderboard.entry import chosen_entrants
from flexlab.analysis.leaderboard.store import RowStore
from flexlab.server.front_server import FrontServer


def test_the_page_shows_the_newest_table_with_its_figures(open_another: Callable[..., FrontServer]):
    server = open_another()
    assert 'href="/leaderboard"' in ask(server.url).text
    page = ask(server.url, "/leaderboard").text
    assert "This table came with flexlab." in page
    assert "B8: " in page
    assert "another version" not in page
    folder = server.settings.logs.parent / "leaderboard"
    quick = [replace(cases()[name], duration=0.012) for name in ("B1", "B2")]
    run_board(make_tasks(quick, chosen_entrants(["pd", "lqr"])), RowStore(folder))
    page = ask(server.url, "/leaderboard").text
    assert "This table came with flexlab." not in page
    assert "B2: From rest to rest" in page
    assert "<code>lqr</code>: <span>sampled, Control period T_c (s)\xa0=\xa00.001</span>" in page
    assert "max √(e_x² + e_y²)" in page
    address = page.split('class="figure" src="')[1].split('"')[0]
    drawing = ask(server.url, address)
    assert drawing.headers["Content-Type"].startswith("image/svg+xml")
    assert drawing.text.startswith("<svg")
    for wrong in (address.replace("B1", "B9"), "/leaderboard/0/B1.svg"):
        assert ask(server.url, wrong).status == 404
    row = next((folder / "rows").iterdir())
    row.write_text(json.dumps({**json.loads(row.read_text()), "engine": "another"}))
    assert "Some rows were computed by another version" in ask(server.url, "/leaderboard").text


def test_a_computation_that_cannot_save_its_rows_says_so(open_another: Callable[..., FrontServer]):
    server = open_another()
    (server.settings.logs.parent / "leaderboard").write_text("no folder")
    assert json.loads(ask(server.url, "/leaderboard/state").text)["working"] is False
    assert ask(server.url, "/leaderboard", method="POST").status == 303
    assert json.loads(ask(server.url, "/leaderboard/state").text)["working"]
    state = over(server.url, "/leaderboard/state", 120)
    assert state["kind"] == "bad"
    assert "cannot be written" in state["sentence"]
