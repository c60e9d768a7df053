"""The swim page and pages of the site as axe-core judges them: nothing serious."""

from importlib.resources import files

import pytest

from salpchain.web.swim_page import swim_page
from tests.web.browser import open_browser, until, watched

AXE = (files("axe_playwright_python") / "axe.min.js").read_text(encoding="utf-8")
SERIOUS = """async () => {
    const { violations } = await axe.run(document, { iframes: false });
    return violations.filter(({ impact }) => ["serious", "critical"].includes(impact))
        .map(({ id, nodes }) => `${id}: ${nodes.slice(0, 3).map(({ html }) => html).join(" ")}`);
}"""


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    place = tmp_path_factory.mktemp("page") / "index.html"
    place.write_text(swim_page())
    return place.as_uri()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_swim_page_has_no_serious_finding(address, scheme):
    with open_browser() as browser, watched(browser, address, color_scheme=scheme) as page:
        until(page, "live.states > 2")
        page.evaluate(AXE)
        page.click("#trouble")
        assert page.evaluate(SERIOUS) == []
        page.click("#scenes")
        assert page.evaluate(SERIOUS) == [] and page.is_hidden("#troubles")
        page.click("[data-scene=task]")
        assert page.evaluate(SERIOUS) == []
