"""What an index would give: the wheel works with nothing beside it but what it says it needs.

Packages of the tests' own environment are linked into an empty one, so nothing is downloaded. That
shows that the declared requirements are enough; not that an installer finds these versions.
"""

import json
import os
import re
import signal
import subprocess
import sys
import tarfile
import venv
from importlib.metadata import distribution, distributions
from pathlib import Path
from urllib.request import urlopen
from zipfile import ZipFile

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from websockets.sync.client import connect

from tests.documents import ROOT

EXTRAS = {"live", "onnx"}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The source archive of this repository, and the wheel that is built from that archive."""
    folder = tmp_path_factory.mktemp("dist")
    build(ROOT, folder, "sdist")
    (source,) = folder.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        archive.extraction_filter = getattr(tarfile, "data_filter", None)  # Python 3.11.4 on
        archive.extractall(folder / "source")
    build(next((folder / "source").iterdir()), folder, "wheel")
    (wheel,) = folder.glob("*.whl")
    return source, wheel


@pytest.fixture(scope="module")
def env(built, tmp_path_factory):
    """The `bin` of an environment with the wheel, its requirements, and nothing else."""
    folder = tmp_path_factory.mktemp("empty") / "env"
    venv.create(folder, with_pip=False, symlinks=True)
    python = folder / "bin" / "python"
    (site,) = folder.glob("lib/python*/site-packages")
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", str(python), "install", "--no-deps",
         "--no-index", "--quiet", str(built[1])], check=True,
    )  # fmt: skip
    (ours,) = distributions(path=[str(site)])
    needed: dict[str, set[str]] = {}
    for line in asked_by(ours, EXTRAS):
        add_requirements(line, needed)
    for name in needed:
        link(name, site)
    return folder / "bin"


def build(source, folder, target):
    command = [sys.executable, "-m", "hatchling", "build", "-d", str(folder), "-t", target]
    subprocess.run(command, cwd=source, check=True, capture_output=True)


def asked_by(package, extras):
    """What a package requires here with these extras."""
    for line in package.requires or []:
        marker = Requirement(line).marker
        if marker is None or any(marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            yield line


def add_requirements(text, found):
    """Adds the package that is asked for, and all that it needs, to the extras by name."""
    wanted = Requirement(text)
    name = canonicalize_name(wanted.name)
    if name in found and wanted.extras <= found[name]:
        return
    found[name] = found.get(name, set()) | wanted.extras
    for line in asked_by(distribution(name), found[name]):
        add_requirements(line, found)


def link(name, site):
    """Makes an installed package visible in another environment."""
    there = distribution(name)
    for top in {file.parts[0] for file in there.files or [] if file.parts[0] != ".."}:
        if top != "__pycache__" and not (site / top).exists():
            (site / top).symlink_to(Path(str(there.locate_file(top))).resolve())


def outside():
    """Variables of a shell that knows nothing of this repository."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def run(env, folder, *words):
    return subprocess.run(
        [env / "salpchain", *words], cwd=folder, env=outside(), capture_output=True, text=True,
        check=False, timeout=300,
    )  # fmt: skip


def test_an_index_accepts_both_files_and_shows_a_readme_without_dead_ends(built):
    command = [sys.executable, "-m", "twine", "--no-color", "check", "--strict", *map(str, built)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    with ZipFile(built[1]) as wheel:
        (about,) = (name for name in wheel.namelist() if name.endswith("METADATA"))
        page = wheel.read(about).decode().partition("\n\n")[2]
    assert page.startswith("# salpchain\n") and len(page) > 3000
    targets = re.findall(r"\]\(([^)]*)\)", page)
    assert targets and all(target.startswith("https://") for target in targets)


def test_the_package_comes_from_the_wheel_alone(env, tmp_path):
    code = "import salpchain, importlib.util as u; print(salpchain.__file__, u.find_spec('torch'))"
    done = subprocess.run(
        [env / "python", "-c", code], cwd=tmp_path, env=outside(), capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    path, torch = done.stdout.split()
    assert Path(path).is_relative_to(env.parent) and torch == "None"


@pytest.mark.parametrize(
    ("words", "file"),
    [
        (["evaluate", "any-length", "--lengths", "2", "--trials", "2", "--out", "e"], "e"),
        (["export", "any-length", "--out", "salps.onnx"], "salps.onnx"),
        (["replay", "any-length", "--length", "2", "--out", "swim.html"], "swim.html"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_a_command_works_from_the_wheel(words, file, env, tmp_path):
    done = run(env, tmp_path, *words)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / file).exists()


def test_what_is_missing_is_named_with_the_wheel_that_has_it(env, built, tmp_path):
    done = run(env, tmp_path, "video", "any-length", "--length", "2", "--out", "swim.mp4")
    assert done.returncode == 2
    assert f"install 'salpchain[video] @ {built[1].as_uri()}'" in done.stderr


def test_the_live_page_swims_from_the_wheel(env, tmp_path):
    server = subprocess.Popen(
        [env / "salpchain", "live", "--port", "0"], cwd=tmp_path, env=outside(), text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        assert server.stdout is not None
        port = re.search(r"http://127\.0\.0\.1:(\d+)", server.stdout.readline())
        assert port is not None, server.communicate(timeout=30)
        with urlopen(f"http://127.0.0.1:{port[1]}/", timeout=30) as page:
            assert b"<canvas" in page.read()
        address = f"ws://127.0.0.1:{port[1]}/swim"
        with connect(address, origin=f"http://127.0.0.1:{port[1]}") as swim:
            welcome, first = (json.loads(swim.recv(timeout=120)) for _ in range(2))
        assert "any-length" in welcome["policies"] and first["type"] == "state"
    finally:
        server.send_signal(signal.SIGINT)
        server.communicate(timeout=60)
    assert server.returncode in (0, 130)
