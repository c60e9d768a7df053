"""The site: its pages are all there, their links lead somewhere, and the notebooks run."""

import os
import re
import runpy
import subprocess
import sys
from dataclasses import fields

import pytest

from salpchain.evaluation.trajectory import Trajectory
from tests.documents import PAGES, ROOT

SITE = runpy.run_path(str(ROOT / "docs" / "site.py"))
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.py"))
LINK = re.compile(r"\]\(([^)\s#]+)[^)\s]*\)")
FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def staged(tmp_path_factory):
    folder = tmp_path_factory.mktemp("staged")
    SITE["stage"](folder)
    return folder


def test_every_page_of_the_repository_is_in_the_site():
    there = {ROOT / source for source in SITE["places"]()}
    assert set(PAGES) <= there


def test_staged_pages_lead_only_to_what_is_staged(staged):
    pages = sorted(staged.rglob("*.md"))
    assert len(pages) > 50
    for page in pages:
        for lead in LINK.findall(FENCE.sub("", page.read_text())):
            if "://" not in lead and not lead.startswith("mailto:"):
                goal = (page.parent / lead).resolve()
                assert goal.is_file() and goal.is_relative_to(staged.resolve()), (page, lead)


def test_the_command_line_is_told_by_its_parsers(staged):
    text = (staged / "cli.md").read_text()
    for name, said in (("train", "--length"), ("live", "--allow-origin"), ("export", "onnx")):
        assert said in text.partition(f"## salpchain {name}\n")[2].partition("\n## ")[0]


def test_a_link_that_leads_nowhere_is_found(tmp_path):
    one = '<h1 id="top"></h1><a href="b.html#there">b</a><img src="c.png">'
    (tmp_path / "a.html").write_text(one)
    other = '<a href="a.html#top">a</a><a href="https://example.org">x</a>'
    (tmp_path / "b.html").write_text(other)
    wrong = list(SITE["broken"](tmp_path))
    assert len(wrong) == 2 and "heading" in wrong[0] and "c.png" in wrong[1]


def test_every_field_of_a_trajectory_is_in_the_reference():
    text = (ROOT / "docs" / "formats.md").read_text()
    for field in fields(Trajectory):
        assert field.name == "around" or f"`{field.name}`" in text, field.name


@pytest.mark.slow
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(notebook, tmp_path):
    done = subprocess.run(
        [sys.executable, str(notebook)], cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_site_is_built_and_all_its_links_lead_somewhere(tmp_path):
    assert SITE["build"](tmp_path / "site") == 0
    home = (tmp_path / "site" / "index.html").read_text()
    assert 'src="swim/index.html' in home
    assert not re.search(r'<(?:script|link)[^>]+(?:src|href)="(?:https?:)?//', home)
    assert (tmp_path / "site" / "swim" / "index.html").stat().st_size > 100_000
