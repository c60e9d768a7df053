"""The swim page and pages of the site as axe-core judges them: nothing serious."""

import runpy
from importlib.resources import files

import pytest

from salpchain.web.swim_page import swim_page
from tests.documents import ROOT
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


FOUND = """() => {
    const links = (root) => [...root.querySelectorAll("*")].flatMap((one) => (
        one.shadowRoot ? links(one.shadowRoot) : one.matches("ol a") ? [one.href] : []));
    return links(document).some((href) => href.includes("gallery.html"));
}"""

PAGES = ("index", "gallery", "api", "measurements", "tasks")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("built") / "site"
    assert runpy.run_path(str(ROOT / "docs" / "site.py"))["build"](folder) == 0
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pages_of_the_site_have_no_serious_finding(site, scheme):
    with open_browser() as browser:
        for name in PAGES:
            address = (site / f"{name}.html").as_uri()
            with watched(browser, address, color_scheme=scheme) as page:
                page.evaluate(AXE)
                assert page.evaluate(SERIOUS) == [], name
                page.wrong.clear()  # of the swim page's frame: from disk it is of another origin


@pytest.mark.slow
def test_the_search_works_from_disk(site):
    address = (site / "tasks.html").as_uri()
    with open_browser() as browser, watched(browser, address) as page:
        page.keyboard.press("/")
        page.wait_for_timeout(500)  # until it listens
        page.keyboard.type("caravan")
        until(page, FOUND)
