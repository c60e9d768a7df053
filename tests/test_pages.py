"""All code of README and docs is tried: programs run, commands run or are read by their parser."""

import os
import re
import runpy
import subprocess
import sys
import tomllib
from importlib import import_module
from importlib.metadata import metadata
from importlib.util import find_spec

import pytest
from packaging.requirements import Requirement
from PIL import Image

import salpchain
from salpchain.cli.main import COMMANDS, run
from salpchain.cli.train import Train, settings
from salpchain.controllers.named import is_name
from salpchain.evaluation.config import parse_lengths
from salpchain.plugins import is_path
from salpchain.tasks.config import TIME_LIMITS
from tests.documents import (
    LANGUAGES,
    PAGES,
    ROOT,
    anchors,
    blocks,
    commands,
    inline_commands,
    links,
    name_of,
)

BLOCKS = [block for page in PAGES for block in blocks(page)]
# Those of docs/interop run in tests/interop/test_docs.py.
PROGRAMS = [b for b in BLOCKS if b.language == "python" and "interop" not in b.page.parts]
SAID = {
    "README": r"closed -?\d+ %",
    "docs-see": r"greedy, 2 units: closed -?\d+ %",
    "docs-any-length": r"any-length: \(4, 1\)\napproach: \(4, 1\)\ngreedy: \(4, 1\)\n",
    "docs-compare": r"mean",
}
RECIPES = sorted((ROOT / "docs" / "recipes").glob("*.md"))
SMALLER = re.compile(r"(n_trials=)\d+\)")  # one trial of a search is enough
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
# Words of a shell around ours, and those of a cluster, which no test has.
SHELL = {"source", "export", "ray", "scontrol", "head", "srun"}

# The README's own commands, in its order, made small; None: run by another test, or too slow.
SMALL = {
    "train": ["--length", "2", "--steps", "16384"],
    "evaluate": ["--lengths", "2,4", "--trials", "2"],
    "figure": [],
    "models": [],
    "best": ["--lengths", "2"],
    "video": ["--length", "2", "--size", "160x90", "--rate", "5"],
    "reproduce": ["--dry-run"],
    "live": None,  # tests/test_wheel.py
    "bench": None,
}


def names(page_or_block):
    return page_or_block.name if hasattr(page_or_block, "code") else name_of(page_or_block)


@pytest.mark.parametrize("block", BLOCKS, ids=names)
def test_every_block_says_what_it_is(block):
    assert block.language in LANGUAGES


@pytest.mark.slow
@pytest.mark.parametrize("block", PROGRAMS, ids=names)
def test_a_program_runs(block, tmp_path):
    """As a file, for some name what is in it as `mine:NAME`."""
    (tmp_path / "mine.py").write_text(SMALLER.sub(r"\g<1>1)", block.code))
    done = subprocess.run(
        [sys.executable, "mine.py"], cwd=tmp_path, capture_output=True, text=True,
        check=False, env={**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert re.search(SAID.get(name_of(block.page), ""), done.stdout)


@pytest.mark.parametrize("page", RECIPES, ids=names)
def test_a_recipe_is_short_and_imports_nothing_from_inside_the_package(page):
    assert len(page.read_text().splitlines()) <= 40
    (program,) = (block.code for block in blocks(page) if block.language == "python")
    inside = re.findall(r"^\s*(?:from|import) salpchain\.?(\S*)", program, re.MULTILINE)
    assert "" in inside and all(name.partition(".")[0] in ("", "interop") for name in inside)
    for name in re.findall(r"salpchain\.(\w+)", program):
        assert name in (*salpchain.__all__, "interop")


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language == "sh"], ids=names)
def test_every_command_of_a_block_is_one_that_its_program_takes(block, monkeypatch):
    for words in commands(block.code):
        check(words, monkeypatch)


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_every_command_in_the_text_is_one_that_its_program_takes(page, monkeypatch):
    for words in inline_commands(page):
        check(words, monkeypatch)


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language == "toml"], ids=names)
def test_a_file_of_settings_is_one_that_train_takes(block, tmp_path):
    (tmp_path / "mine.toml").write_text(block.code)
    asked = settings(Train(out="new", config=str(tmp_path / "mine.toml")), tmp_path / "new")
    assert asked.steps == tomllib.loads(block.code)["steps"]


def test_every_example_of_the_help_is_one_that_its_command_takes(monkeypatch, capsys):
    assert run(["--help"]) == 0
    pages = capsys.readouterr().out
    for name in COMMANDS:
        assert run([name, "--help"]) == 0
        page = capsys.readouterr().out
        assert "xample: salpchain" in page
        pages += page
    found = re.findall(r"^(?:Example:)? *(salpchain [a-z]+ .*)$", pages, re.MULTILINE)
    assert len(found) > len(COMMANDS)
    for example in found:
        check(commands(example)[0], monkeypatch)


def check(words, monkeypatch):
    """Fails unless the command exists and takes these words."""
    while re.fullmatch(r"\w+=.*", words[0]):
        words = words[1:] or ["export"]
    if "salpchain" in words:  # what a launcher starts
        words = words[words.index("salpchain") :]
    program, *rest = words
    if program == "salpchain":
        check_ours(rest, monkeypatch)
    elif program == "make":
        assert all(re.search(rf"^{goal}:", (ROOT / "Makefile").read_text(), re.M) for goal in rest)
    elif program in ("python", "python3"):
        assert find_spec(rest[1]) if rest[0] == "-m" else (ROOT / rest[0]).is_file(), words
    elif program == "pip":
        assert rest[0] == "install"
        check_requirement(rest[-1])
    else:
        assert program in SHELL, words


def check_requirement(text):
    """Fails unless the package has these extras; NAME stands for any."""
    wanted = Requirement(text.replace(".[", "salpchain[", 1) if text.startswith(".") else text)
    theirs = () if wanted.name == "salpchain" else metadata(wanted.name).get_all("Provides-Extra")
    assert wanted.extras <= {*(theirs or EXTRAS), "NAME"}, text


def check_ours(words, monkeypatch):
    """Fails unless the command's own parser takes the words and their values are sound."""
    if not words or words[0] in ("COMMAND", "--version", "--help"):
        return
    if words[0] == "completion":  # its one argument is the shell
        return
    taken = []
    monkeypatch.setenv("SALPCHAIN_CACHE", "off")
    module = import_module(f"salpchain.cli.{words[0]}")
    monkeypatch.setattr(module, "run", taken.append)
    assert run(words) == 0, words
    for options in taken:
        for name in ("length", "lengths"):
            if value := getattr(options, name, ""):
                assert parse_lengths(value)
        assert getattr(options, "time_limit", "fixed") in TIME_LIMITS
        source = getattr(options, "policy", "") or getattr(options, "source", "")
        own = is_name(source) or is_path(source)
        assert not source or own or "/" in source or source.isupper(), source


@pytest.mark.slow
def test_the_readmes_commands_run_in_their_order(tmp_path):
    ours = [w[1:] for b in blocks(PAGES[0]) if b.language == "sh" for w in commands(b.code)
            if w[0] == "salpchain" and SMALL[w[1]] is not None]  # fmt: skip
    trained = False
    for words in ours:
        if words[0] == "train":
            if trained:  # once is enough: the others differ in their lengths
                continue
            trained = True
        done = subprocess.run(
            [sys.executable, "-m", "salpchain", *words, *SMALL[words[0]]], cwd=tmp_path,
            capture_output=True, text=True, check=False,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        if "--out" in words and words[0] != "reproduce":
            assert (tmp_path / words[words.index("--out") + 1]).exists()


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md"], ids=names)
def test_every_link_into_the_repository_leads_somewhere(page):
    for target in links(page):
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), target
        if anchor:
            assert anchor in anchors(there), target


def test_every_page_is_in_the_index():
    index = {(ROOT / "docs" / target.partition("#")[0]).resolve() for target in
             links(ROOT / "docs" / "README.md")}  # fmt: skip
    for page in [*(ROOT / "docs").glob("*.md"), *RECIPES]:
        assert page in index or page.name == "README.md", page


def test_the_reference_of_public_names_is_what_its_script_writes():
    script = runpy.run_path(str(ROOT / "docs" / "api.py"))
    named = " ".join(script["SECTIONS"].values()).split()
    assert sorted(named) == sorted(salpchain.__all__)
    assert script["page"]() == (ROOT / "docs" / "api.md").read_text(), "run python docs/api.py"


def test_the_readme_begins_with_a_picture_that_moves():
    picture = links(PAGES[0])[0]
    assert PAGES[0].read_text().splitlines()[2].endswith(f"({picture})")
    with Image.open(ROOT / picture) as image:
        assert image.n_frames > 20
    assert (ROOT / picture).stat().st_size < 1.5e6


def test_the_readme_names_every_extra_and_no_other():
    section = PAGES[0].read_text().partition("## Installing")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (`[^|]*)\|", section, re.MULTILINE)
    assert {name for row in rows for name in re.findall(r"`([^`]+)`", row)} == set(EXTRAS)


def test_the_citation_is_of_this_version_and_of_the_paper_that_the_metadata_links():
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"version: {salpchain.__version__}\n" in citation
    paper = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["urls"]["Paper"]
    assert f'url: "{paper}"' in citation and paper in PAGES[0].read_text()
