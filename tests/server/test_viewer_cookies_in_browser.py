"""Behind a hub's login every request needs the visitor's cookies, but rerun's viewer requests recordings without them."""

from playwright.sync_api import Browser

from flexlab.server.front_server import FrontServer


def test_the_viewer_requests_recordings_with_the_visitor_s_cookies(plain_chromium: Browser, front_server: FrontServer):
    window = plain_chromium.new_context()
    window.add_cookies([{"name": "hub", "value": "ann", "url": front_server.url}])
    page = window.new_page()
    page.route("**/re_viewer*", lambda route: route.abort())  # Nobody looks at what it draws.
    page.goto(f"{front_server.url}viewer/", wait_until="domcontentloaded")
    with page.expect_request("**/runs/one.rrd") as asked:
        page.evaluate("fetch(new Request('/runs/one.rrd', { credentials: 'omit' }))")
    assert "hub=ann" in asked.value.all_headers()["cookie"]
    window.close()
