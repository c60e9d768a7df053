"""Runs that have one name are told apart, and none is dropped."""

from pathlib import Path

import pytest

from salpchain.errors import InputError
from salpchain.report.labels import check_once, distinguishing, labels


@pytest.mark.parametrize(
    ("paths", "told"),
    [
        (["runs/a", "runs/b"], ["a", "b"]),
        (["a", "b"], ["a", "b"]),
        (["x/a/evaluation", "x/b/evaluation"], ["a", "b"]),
        (["one/seed-0", "one/seed-1", "two/seed-0"], ["one/seed-0", "one/seed-1", "two/seed-0"]),
        (["runs/a", "runs/a/evaluation"], ["a", "a/evaluation"]),
        (["here/a.npz", "there/b.npz"], ["here/a.npz", "there/b.npz"]),
        (["a/x/c", "a/y/c", "a/z/d"], ["x/c", "y/c", "z/d"]),
    ],
)
def test_paths_are_shortened_to_what_tells_them_apart(paths, told):
    assert distinguishing([Path(path) for path in paths]) == told


def test_names_are_kept_where_they_tell_apart_and_no_two_labels_are_alike():
    folders = [Path("runs/a"), Path("runs/b"), Path("runs/c")]
    assert labels(["x", "y", "z"], folders) == ["x", "y", "z"]
    assert labels(["x", "y", "x"], folders) == ["a", "y", "c"]
    assert labels(["x", "x", "a"], folders) == ["runs/a", "b", "runs/c"]
    assert labels(["_x", "y", "z"], folders)[0] == " _x"  # Matplotlib does not draw "_x"


def test_the_same_place_twice_is_refused_however_it_is_written(tmp_path):
    (tmp_path / "a").mkdir()
    check_once([tmp_path / "a", tmp_path / "b"])
    with pytest.raises(InputError, match="is given twice"):
        check_once([tmp_path / "a", tmp_path / "b" / ".." / "a"])
