"""The page of a suite says what its cells do."""

import re

import pytest

from salpchain.report.suite import heat_map, suite_page, verdict


def cell(trouble, grade, length, mean, **more):
    success = {"mean": mean, "low": max(0.0, mean - 0.1), "high": min(1.0, mean + 0.1)}
    value = {"mean": 0.5, "median": 1.25, "iqm": 0.5, "low": 0.4, "high": 0.6}
    return {
        "trouble": trouble, "grade": grade, "length": length, "trials": 10, "success": success,
        "possible": 0.9, "closed_fraction": value, "steps_to_goal": value, "time_ratio": value,
        "loss": {"mean": 1 - mean, "low": 0.0, "high": None if mean == 1 else 1.0}, **more,
    }  # fmt: skip


CELLS = [
    cell("still", "none", 4, 1.0),
    cell("delay", "easy", 4, 0.8),
    cell("delay", "hard", 4, 0.25, kinds={"both": {"mean": 0.25}, "one": {"mean": 0.5}}),
    cell("still", "none", 8, 1.0),
    cell("delay", "easy", 8, 0.9),
    cell("delay", "hard", 8, 0.75, kinds={"both": {"mean": 1.0}, "one": {"mean": 0.5}}),
]
SUMMARY = {
    "policy": "mine", "identity": "abc", "suite": "sea", "version": 1, "lengths": [4, 8],
    "trials": 10, "time_limit": "scaled", "seed": 0, "cells": CELLS,
}  # fmt: skip


def test_the_verdict_names_each_grades_mean_and_the_worst_cell():
    assert verdict(CELLS) == (
        "Success, mean over cells: easy 85 %, hard 50 %; least 25 % (delay hard, 4 units)."
    )
    assert verdict(CELLS[:1]).endswith("least 100 % (still, 4 units).")


def test_the_page_holds_every_cell_and_the_map(tmp_path):
    paths = suite_page(SUMMARY, tmp_path)
    names = ["suite.md", "suite.html", "suite.png", "suite.pdf"]
    assert [path.name for path in paths] == names and all(path.stat().st_size for path in paths)
    text, page = (path.read_text() for path in paths[:2])
    assert "| hard | 4 | 25 (15 to 35) | 75 (0 to 100) | 90 | 50.0 | 1.25 | 25 | 50 |" in text
    assert "| none | 8 | 100 (90 to 100) | 0 | 90 | 50.0 | 1.25 |" in text
    assert len(re.findall("<h2>", page)) == 2 and "data:image/png" in page
    assert "| easy | 4 | 80 (70 to 90) | 20 (0 to 100) | 90 | 50.0 | 1.25 | - | - |" in text
    assert "suite.png" in text and verdict(CELLS) in text


@pytest.mark.parametrize("cells", [CELLS, CELLS[:1]])
def test_the_map_has_a_row_for_each_trouble_and_grade(cells, tmp_path):
    assert heat_map(cells, tmp_path / "map.png")[0].read_bytes()[1:4] == b"PNG"
