"""The code of pages in docs/ runs, and what they name is there."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parent.parent / "docs"


@pytest.mark.parametrize(
    ("page", "said"),
    [
        ("see.md", r"greedy, 2 units: closed -?\d+ %"),
        ("any-length.md", r"any-length: \(4, 1\)\napproach: \(4, 1\)\ngreedy: \(4, 1\)\n"),
    ],
)
def test_the_python_of_a_page_runs(page, said):
    (block,) = re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)
    done = subprocess.run(
        [sys.executable, "-c", block], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert re.search(said, done.stdout)


@pytest.mark.parametrize("page", ["see.md", "any-length.md"])
def test_every_command_on_a_page_is_one_of_ours_and_every_picture_there(page):
    from salpchain.cli.main import COMMANDS

    text = (DOCS / page).read_text()
    assert set(re.findall(r"`salpchain (\w+)", text)) <= set(COMMANDS)
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", text):
        assert (DOCS / picture).exists()
