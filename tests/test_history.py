"""The table of speeds by commit: what is appended, and when a commit counts as slower."""

import csv

import pytest

from benchmarks import history
from salpchain.errors import InputError


def read(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_rows_are_appended_and_a_new_figure_is_empty_in_older_ones(tmp_path):
    table = tmp_path / "history.csv"
    history.append([{"commit": "a", "step": "1.5"}], table)
    history.append([{"commit": "b", "step": "1.4", "start": "3"}], table)
    assert read(table) == [
        {"commit": "a", "step": "1.5", "start": ""},
        {"commit": "b", "step": "1.4", "start": "3"},
    ]


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ((1.0, 1.1, 1.2), (1.3, 1.4, 1.5), True),
        ((1.0, 1.1, 1.2), (1.0, 1.4, 1.5), False),  # a round was as quick
        ((1.0, 1.0, 1.0), (1.05, 1.05, 1.05), False),  # by less than a tenth
        ((1.3, 1.4, 1.5), (1.0, 1.1, 1.2), False),
    ],
)
def test_slower_is_what_no_round_explains(before, after, expected):
    assert history.slower(before, after) is expected


def test_a_commit_that_is_none_is_refused():
    with pytest.raises(InputError, match="--against must be a commit"):
        history.commit_of("nowhere")


def test_a_package_that_cannot_be_measured_says_why(tmp_path):
    (tmp_path / "salpchain.py").write_text("raise RuntimeError('broken on purpose')\n")
    with pytest.raises(InputError, match="cannot be measured: RuntimeError: broken on purpose"):
        history.probed(tmp_path)
