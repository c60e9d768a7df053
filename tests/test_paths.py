"""A path may be a `str` or a `Path`, in every public function that takes one."""

import ast
import re
from pathlib import Path

import pytest

import salpchain
from salpchain.interop.export import export
from salpchain.interop.network import load_torch
from salpchain.report import figures
from salpchain.report.pages import Report, write_report
from salpchain.report.picture import chains_picture
from salpchain.report.replay import write_replay
from salpchain.report.video import Film, write_video
from tests.interop.policies import fresh
from tests.report.swims import swim
from tests.training.small import small

PACKAGE = Path(salpchain.__file__).parent


def public_functions(tree):
    """The public functions of a module and of its public classes, which construct themselves."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public_functions(node)
        elif isinstance(node, ast.FunctionDef) and (
            node.name == "__init__" or not node.name.startswith("_")
        ):
            yield node


def path_parameters():
    """Where a path is taken, and how it is annotated; the command line's own functions apart."""
    for file in sorted(PACKAGE.rglob("*.py")):
        place = file.relative_to(PACKAGE)
        if place.parts[0] == "cli":
            continue
        for function in public_functions(ast.parse(file.read_text(encoding="utf-8"))):
            for given in (*function.args.args, *function.args.kwonlyargs):
                kind = ast.unparse(given.annotation) if given.annotation else ""
                if re.search(r"\bPath\b|StrPath|PathLike", kind):
                    yield f"{place}: {function.name}({given.arg}: {kind})"


def test_no_public_function_takes_only_a_path_object():
    """Pyright sees to it that what is annotated so is made a `Path` before it is used as one."""
    found = list(path_parameters())
    assert len(found) > 40 and any("train(run: StrPath)" in one for one in found)
    assert [one for one in found if re.search(r"\bPath\b", one)] == []


@pytest.mark.parametrize("kind", [str, Path])
def test_what_is_written_by_a_path_of_either_kind_is_read_by_one(kind, tmp_path):
    def at(name):
        return kind(tmp_path / name)

    policy, moves = fresh(), swim(4, times=5)
    salpchain.save_policy(policy, at("policy.safetensors"))
    assert salpchain.load(at("policy.safetensors")).card == policy.card
    moves.save(at("swim.npz"))
    assert salpchain.Trajectory.load(at("swim.npz")).length == 4
    for form in ("onnx", "torch"):
        export(policy, at(f"policy.{form}"), form)
    assert load_torch(at("policy.torch")) is not None
    write_replay([moves], at("swim.html"))
    write_video([moves], at("swim.gif"), Film(64, 64, 5.0, 4.0))
    chains_picture([moves], at("swim.png"))
    write_report(Report("title", "verdict", []), kind(tmp_path))
    assert len(list(tmp_path.iterdir())) == 9


@pytest.mark.parametrize("kind", [str, Path])
def test_a_run_is_trained_resumed_tested_and_drawn_by_a_path_of_either_kind(kind, tmp_path):
    run, tests = kind(tmp_path / "run"), kind(tmp_path / "tests")
    salpchain.train(small(2), run)
    salpchain.resume(run)
    salpchain.evaluate(salpchain.load(run), [3], 1, "fixed", 0, tests)
    made = figures.learning_curves([run], kind(tmp_path / "learning.png"))
    made += figures.zero_shot([tests], kind(tmp_path / "transfer.png"))
    assert len(made) == 4 and all(path.is_file() for path in made)
