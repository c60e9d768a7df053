"""The code of docs/see.md runs."""

import re
import subprocess
import sys
from pathlib import Path

PAGE = (Path(__file__).parent.parent / "docs" / "see.md").read_text()


def test_the_python_of_the_page_runs():
    (block,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    done = subprocess.run(
        [sys.executable, "-c", block], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r"greedy, 2 units: closed -?\d+ %", done.stdout)


def test_every_command_on_the_page_is_one_of_ours_and_every_picture_there():
    from salpchain.cli.main import COMMANDS

    assert set(re.findall(r"`salpchain (\w+)", PAGE)) <= set(COMMANDS)
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", PAGE):
        assert (Path(__file__).parent.parent / "docs" / picture).exists()
