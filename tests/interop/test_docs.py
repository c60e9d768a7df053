"""The programs of docs/interop run as they stand, each in a folder of its own."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parent.parent.parent / "docs" / "interop"
PAGES = sorted(DOCS.glob("*.md"))
PROGRAMS = [
    pytest.param(code, id=f"{page.stem}-{number}")
    for page in PAGES
    for number, code in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL))
]


@pytest.mark.parametrize("code", PROGRAMS)
def test_a_program_of_the_pages_runs_and_is_short(code, tmp_path, monkeypatch):
    """A program that trains says how it went in `scores`: it must improve."""
    assert len([line for line in code.splitlines() if line.strip()]) <= 20
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    names = {"__name__": "__main__"}
    exec(code, names)
    if scores := names.get("scores"):
        assert scores[-1] > scores[0] + 0.1, scores


def test_every_page_has_a_program_and_is_in_the_index():
    index = (DOCS / "README.md").read_text()
    for page in PAGES:
        if page.name != "README.md":
            assert f"({page.name})" in index
            assert "```python" in page.read_text(), page.name


def test_every_extra_in_the_index_is_one_of_the_package():
    import tomllib

    settings = tomllib.loads((DOCS.parent.parent / "pyproject.toml").read_text())
    extras = settings["project"]["optional-dependencies"]
    rows = re.findall(r"^\|[^|]*\|([^|]*)\| \[", (DOCS / "README.md").read_text(), re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`([^`]+)`", row)}
    assert named and named <= set(extras)
