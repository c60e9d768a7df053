"""The plan of the code: who may import whom, and how large things may grow."""

import ast
import pkgutil
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "salpchain"
ROOMS = ["physics", "dynamics", "world", "tasks", "networks", "controllers", "evaluation"]
ROOMS += ["training", "report", "interop", "web", "experiments", "paper", "cli"]
# Files at the bottom, importable by all.
GROUND = {"archive", "compilation_cache", "devices", "errors", "files", "installation"}
GROUND |= {"machine", "trees"}
GROUND |= {"checks", "forks", "given", "plugins", "ranges", "starting", "switches", "xla"}
FILES = sorted(PACKAGE.rglob("*.py"))
OPTIONAL = {"torch", "vmas", "gymnasium", "pettingzoo", "stable_baselines3", "brax", "flax"}
OPTIONAL |= {"torchrl", "tensordict", "benchmarl", "onnx", "onnxruntime", "ray", "starlette"}
OPTIONAL |= {"uvicorn", "websockets", "msgspec", "av", "playwright", "PIL"}


def imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_module_imports_only_from_its_own_room_and_those_below(path):
    room = path.relative_to(PACKAGE).parts[0]
    below = ROOMS[: ROOMS.index(room) + 1] if room in ROOMS else []
    for name in imports(path):
        if name.startswith("salpchain.") and path.stem not in ("__init__", "__main__"):
            assert name.split(".")[1] in {*GROUND, *below}, name


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_files_have_at_most_400_lines_and_functions_at_most_40(path):
    text = path.read_text()
    assert text.count("\n") <= 400
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            assert node.end_lineno - node.lineno < 40, node.name


def test_importing_the_package_imports_no_optional_one_nor_jax():
    code = "import sys, salpchain; print(' '.join(m.split('.')[0] for m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not (OPTIONAL | {"jax"}) & set(done.stdout.split())


def test_all_public_names_can_be_imported():
    import salpchain

    for name in salpchain.__all__:
        assert getattr(salpchain, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'lod'"):
        _ = salpchain.lod


def test_the_pictures_of_the_layout_show_what_is_there():
    """The rooms of architecture.md are those of the code, and an action passes what exists."""
    draw = runpy.run_path(str(PACKAGE.parent / "docs" / "draw.py"))
    assert draw["rooms"]() == ROOMS
    pairs = draw["imports"](ROOMS)
    assert len(pairs) > 50
    upward = [
        pair for pair in pairs if pair[1] in ROOMS and ROOMS.index(pair[1]) > ROOMS.index(pair[0])
    ]
    assert upward == []
    for place, _ in draw["WAY"]:
        assert pkgutil.resolve_name(place) is not None
