"""A first start shows a page at once, which programs do not mistake for the lab."""

import urllib.error
import urllib.request

import pytest

from flexlab.cli.showing import WaitingPage


def test_programs_are_told_that_the_lab_is_not_there_yet():
    with WaitingPage("127.0.0.1", 0) as page, pytest.raises(urllib.error.HTTPError) as caught:
        urllib.request.urlopen(page.url + "/any/path")
    assert caught.value.code == 503
    assert "compiling the equations of motion" in caught.value.read().decode()


def test_the_port_is_free_again():
    with WaitingPage("127.0.0.1", 0) as page:
        port = int(page.url.rsplit(":", 1)[1])
    with WaitingPage("127.0.0.1", port):
        pass
