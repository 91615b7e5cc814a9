"""A page of another origin gets nothing from the port of a lab itself."""

from playwright.sync_api import Browser

from flexlab.server.front_server import FrontServer

OPEN_SOCKET = """(address) => new Promise((done) => {
  const plug = new WebSocket(address, 'viser-v1.1.1');
  plug.onopen = () => done('open'); plug.onmessage = () => done('data'); plug.onerror = () => done('refused'); })"""


def test_a_page_of_another_origin_gets_nothing_from_the_inner_port(front_server: FrontServer, plain_chromium: Browser):
    (lab,) = front_server.places.running()
    context = plain_chromium.new_context()
    try:
        page = context.new_page()
        page.goto(f"http://localhost:{front_server.port}/static/icon.svg")
        assert page.evaluate(OPEN_SOCKET, f"ws://127.0.0.1:{lab.port}/lab") == "refused"
        assert page.evaluate(OPEN_SOCKET, f"ws://127.0.0.1:{front_server.port}/lab") == "refused"
    finally:
        context.close()
