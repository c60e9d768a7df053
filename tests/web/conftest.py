"""A live page with the greedy controller, and a browser to look at it: one of each a file."""

import pytest

from tests.web.browser import live_server, open_browser


@pytest.fixture(scope="module")
def server():
    with live_server("greedy", "--seed", "4") as (address, _):
        yield address


@pytest.fixture(scope="module")
def browser():
    with open_browser() as browser:
        yield browser
