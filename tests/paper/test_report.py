"""The report of a study, whole or not: whole sentences, one line on top, readable on a phone."""

import html
import json
import re

import numpy as np
import pandas as pd
import pytest

from salpchain.controllers.storage import load
from salpchain.errors import InputError
from salpchain.files import read_json
from salpchain.paper import disabled
from salpchain.paper.grid import Grid
from salpchain.paper.report import write_outcome
from salpchain.paper.results import run_of
from salpchain.training.run_folder import create
from tests.web.browser import open_browser, shoot, watched

WIDE = Grid(lengths=(8, 16), seeds=1, trials=10, tests=(4, 8, 16, 24, 32, 40))
NARROW = Grid(models=("mlp",), graphs=(), lengths=(8,), seeds=2, trials=1, tests=(8,))


def evaluation_of(limit, lengths, trials):
    """An evaluation.json whose numbers fall with the length."""
    rows = []
    for length in lengths:
        closed = max(0.0, 1.05 - 0.01 * length)
        mean = {"success": closed, "closed_fraction": closed, "final_distance": 1 - closed}
        about = {"reachable": 1.0, "start_distance": 0.1 * length}
        values = {name: {"mean": value} for name, value in {**mean, **about}.items()}
        rows.append({"length": length, "trials": trials, **values})
    return {"time_limit": limit, "lengths": rows}


def log(rows, ended):
    """A metrics.csv in which episodes have ended or none has."""
    lines = ["iteration,steps,seconds,episodes,success,closed_fraction,reward_approach,reward_goal"]
    some = "10,0.9,0.95" if ended else "0,,"
    lines += [f"{n},{4096 * n},{n},{some},0.01,0" for n in range(1, rows + 1)]
    return "\n".join([*lines, ""])


def study(folder, grid, runs, ended=True, tested=True):
    """A study of which so many runs are whole."""
    for job in grid.jobs()[:runs]:
        run = run_of(folder, job)
        create(run, job.config, devices=1, device="cpu")
        (run / "metrics.csv").write_text(log(40, ended))
        success = 0.9 if ended else None
        (run / "summary.json").write_text(
            json.dumps({"steps": 9, "seconds": 90, "success": success})
        )
        for limit, lengths in job.tests.items() if tested else ():
            (run / limit).mkdir()
            (run / limit / "evaluation.json").write_text(
                json.dumps(evaluation_of(limit, lengths, grid.trials))
            )
    return write_outcome(folder, grid)


CASES = {
    "whole": (WIDE, 99, {}),
    "one run": (WIDE, 1, {}),
    "two runs": (WIDE, 3, {}),
    "no episode has ended": (WIDE, 5, {"ended": False}),
    "not tested": (WIDE, 5, {"tested": False}),
    "neither": (WIDE, 2, {"ended": False, "tested": False}),
    "one model": (NARROW, 99, {}),
}


def prose(page):
    """All sentences of the page: the paragraphs, captions, and cells of claims."""
    inside = re.findall(r"<(?:p|figcaption)\b[^>]*>(.*?)</(?:p|figcaption)>", page, re.DOTALL)
    claims = page.split('class="wide words"')[1].split("</table>")[0]
    evidence = [re.findall(r"<td[^>]*>(.*?)</td>", row)[2] for row in claims.split("<tr>")[1:]]
    return [html.unescape(re.sub(r"<[^>]+>", "", text)) for text in [*inside, *evidence]]


@pytest.mark.slow
@pytest.mark.parametrize(("grid", "runs", "how"), CASES.values(), ids=CASES)
def test_every_sentence_is_whole(tmp_path, grid, runs, how):
    page = study(tmp_path, grid, runs, **how).read_text()
    found = prose(page)
    assert len(found) > 5
    for text in found:
        assert re.fullmatch(r"[A-Z0-9p].*\.", text), text
        assert not re.search(r"[:;,]\s*[:;,.()]|\(\s*[),;]|:\s*$|  |\bnan\b|\bNone\b", text), text
        assert text.count("(") == text.count(")"), text
        assert not re.search(r"\b1 (seeds|trials|models|hours)\b", text), text
    assert "`" not in page and "nan" not in re.sub(r"base64,[^\"]+", "", page)


def test_what_was_not_trained_or_has_no_episode_is_called_so(tmp_path):
    page = study(tmp_path / "a", WIDE, 2, ended=False).read_text()
    assert "mlp no episode has ended (0.93)" in page and "gt full not trained (0.965)" in page
    page = study(tmp_path / "b", WIDE, 1).read_text()
    assert "Not one of the best controllers has been tested yet." in page


@pytest.mark.slow
def test_one_line_on_top_counts_the_claims_and_the_runs(tmp_path):
    place = study(tmp_path, WIDE, 3)
    record = json.loads((place.parent / "study.json").read_text())
    count = [sum(c["held"] is x for c in record["claims"]) for x in (True, False, None)]
    line = (
        f"{count[0]} of the paper's {sum(count)} claims held here, {count[1]} did not and"
        f" {count[2]} cannot be told; so far 3 of {len(WIDE.jobs())} runs are whole."
    )
    page, text = place.read_text(), place.with_suffix(".md").read_text()
    assert prose(page)[0] == line
    assert text.split("\n\n")[1] == f"**{line}**"
    assert f"all {len(WIDE.jobs())} runs are whole." in study(tmp_path / "b", WIDE, 99).read_text()


@pytest.mark.slow
def test_figures_come_before_tables(tmp_path):
    place = study(tmp_path, WIDE, 99)
    page, text = place.read_text(), place.with_suffix(".md").read_text()
    assert page.count("<img") == 3 and page.rindex("<img") < page.index("<table")
    assert text.rindex("![") < text.index("| --- |")


@pytest.fixture(scope="module")
def browser():
    with open_browser() as browser:
        yield browser


WIDE_PARTS = """() => [...document.querySelectorAll(".wide")].map((part) =>
    [part.getBoundingClientRect().right, getComputedStyle(part).overflowX])"""
CONTRAST = """() => {
    const parts = (c) => c.match(/[\\d.]+/g).slice(0, 3).map((v) => {
        const s = v / 255; return s <= 0.04045 ? s / 12.92 : ((s + 0.055) / 1.055) ** 2.4; });
    const light = (c) => parts(c).reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
    const behind = (e) => { while (e) { const c = getComputedStyle(e).backgroundColor;
        if (!/, 0\\)$/.test(c)) return c; e = e.parentElement; } return "rgb(255, 255, 255)"; };
    return [...document.querySelectorAll("h1, h2, p, td, th, figcaption, code")].map((e) => {
        const [a, b] = [light(getComputedStyle(e).color), light(behind(e))];
        return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05); });
}"""


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_the_page_fits_its_screen_and_can_be_read_in_light_and_dark(
    tmp_path, browser, width, scheme
):
    place = study(tmp_path, WIDE, 99).as_uri()
    look = {"viewport": {"width": width, "height": 800}, "color_scheme": scheme}
    with watched(browser, place, **look) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        boxes = page.evaluate(WIDE_PARTS)
        assert all(right <= width and flow == "auto" for right, flow in boxes)
        assert min(page.evaluate(CONTRAST)) > 4.5
        paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
        dark = np.mean([float(x) for x in re.findall(r"\d+", paper)[:3]]) < 64
        assert dark == (scheme == "dark")
        assert page.locator("td").first.bounding_box()["width"] > 100
        shoot(page, f"report-{scheme}-{width}")


def test_disabled_units_go_from_none_to_half_of_the_training_length_but_never_to_all():
    for length, most in ((4, 3), (8, 4), (16, 4)):
        cells = list(disabled.cells_of(8, length))
        assert [(cell.grade, *cell.worlds) for cell in cells] == [
            (str(dead), mask) for dead in range(most + 1) for mask in ("one", "each")
        ]
        assert [cell.once for cell in cells] == [True, False] * (most + 1)
        for cell in cells:
            (world,) = cell.worlds.values()
            assert round(world.thrusters.dead.low * length) == int(cell.grade)
    assert disabled.lengths_of(load("paper-gcn-16"), 16) == [8, 16, 24, 32]


def test_the_experiment_with_disabled_units_goes_on_and_refuses_other_results(
    tmp_path, monkeypatch
):
    played = []

    def play(policy, trained, trials, seed, progress):
        played.append(policy.card.name)
        rows = [
            {"policy": policy.card.name, "trained": trained, "length": length, "disabled": dead,
             "mask": mask, "success": trial > dead, "closed_fraction": 1 - dead / 10,
             "distance_reward": 2.0 - dead}
            for length in disabled.lengths_of(policy, trained) for dead in range(3)
            for mask in ("one", "each") for trial in range(trials)
        ]  # fmt: skip
        return pd.DataFrame(rows)

    monkeypatch.setattr(disabled, "play", play)
    one, two = load("paper-gcn-8"), load("paper-gt-8")
    disabled.experiment([one], [8, 16], 5, 0, tmp_path)
    files = disabled.experiment([one, two], [8, 16], 5, 0, tmp_path)
    assert played == ["paper-gcn-8", "paper-gt-8"]
    assert [file.name for file in files] == ["disabled.json", "disabled.png", "disabled.pdf"]
    cells = read_json(files[0])["cells"]
    assert len(cells) == 2 * 4 * 3 * 2
    (cell,) = (
        c for c in cells if [c[k] for k in ("policy", "length", "disabled", "mask")]
        == ["paper-gt-8", 16, 2, "each"]
    )  # fmt: skip
    assert cell["success"]["mean"] == pytest.approx(2 / 5) and cell["trials"] == 5
    assert cell["closed_fraction"]["mean"] == pytest.approx(0.8)
    assert cell["distance_reward"]["mean"] == pytest.approx(0.0)
    with pytest.raises(InputError, match=r"holds other results .trials 5, 6 asked for"):
        disabled.experiment([one], [8], 6, 0, tmp_path)
    with pytest.raises(InputError, match=r"paper-gcn-8 was trained on 8 units, none of .* 16"):
        disabled.experiment([one], [16], 5, 0, tmp_path)
