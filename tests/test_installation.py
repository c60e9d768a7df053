"""Messages name commands that work where they are read, however the package came there."""

import json
import shlex
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from salpchain import installation

ROOT = Path(__file__).parent.parent


class Installed:
    """A distribution with this note of its installer."""

    def __init__(self, note):
        self.note = note

    def read_text(self, name):
        assert name == "direct_url.json"
        return self.note


def asked(note, monkeypatch):
    """The words after `install` of the command that adds the extra `live`."""
    text = note if note is None or isinstance(note, str) else json.dumps(note)
    monkeypatch.setattr(installation, "distribution", lambda _: Installed(text))
    words = shlex.split(installation.install_command("live"))
    return words[words.index("install") + 1 :]


@pytest.mark.parametrize("note", [None, "", "no json"])
def test_what_came_from_an_index_comes_from_there_again(note, monkeypatch):
    assert asked(note, monkeypatch) == ["salpchain[live]"]


def test_a_clone_is_installed_again_from_its_folder(tmp_path, monkeypatch):
    folder = tmp_path / "a clone"
    folder.mkdir()
    (folder / "pyproject.toml").touch()
    note = {"url": folder.as_uri(), "dir_info": {"editable": True}}
    assert asked(note, monkeypatch) == ["--editable", f"{folder}[live]"]
    assert asked({**note, "dir_info": {}}, monkeypatch) == [f"{folder}[live]"]
    (folder / "pyproject.toml").unlink()  # the clone is gone: the index is what is left
    assert asked(note, monkeypatch) == ["salpchain[live]"]


@pytest.mark.parametrize(
    ("note", "url"),
    [
        ({"url": "file:///d/s.whl", "archive_info": {}}, "file:///d/s.whl"),
        (
            {"url": "https://example.org/s", "vcs_info": {"vcs": "git", "commit_id": "abc"}},
            "git+https://example.org/s@abc",
        ),
    ],
)
def test_a_wheel_or_a_commit_is_named_as_it_was(note, url, monkeypatch):
    (word,) = asked(note, monkeypatch)
    wanted = Requirement(word)
    assert (wanted.name, wanted.extras, wanted.url) == ("salpchain", {"live"}, url)


def test_a_copy_that_was_never_installed_is_named_by_its_folder(monkeypatch):
    def missing(_):
        raise PackageNotFoundError

    monkeypatch.setattr(installation, "distribution", missing)
    assert shlex.split(installation.install_command("live"))[-2:] == ["--editable", f"{ROOT}[live]"]


def test_the_installer_and_the_program_are_those_of_this_environment(tmp_path, monkeypatch):
    """Another `pip` or `salpchain` may come first in the shell, as without activation."""
    folder = tmp_path / "env" / "bin"
    folder.mkdir(parents=True)
    for name in ("python", "pip", "salpchain"):
        (folder / name).touch(mode=0o755)
    monkeypatch.setattr(sys, "executable", str(folder / "python"))
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.chdir(tmp_path)
    assert installation.program() == "env/bin/salpchain"
    assert installation.install_command("live").startswith("env/bin/python -m pip install ")
    monkeypatch.setenv("PATH", str(folder))
    assert installation.program() == "salpchain"
    assert installation.install_command("live").startswith("pip install ")
    (folder / "salpchain").unlink()
    assert installation.program() == "env/bin/python -m salpchain"
