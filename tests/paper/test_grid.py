"""Which runs a study has, and which grids cannot be."""

import json
from dataclasses import asdict

import pytest

from salpchain.errors import InputError
from salpchain.paper.grid import Grid, check_folder, claim, read_grid


def test_the_papers_grid_has_14_configurations_and_tests_each_as_the_paper_does():
    grid = Grid(seeds=3)
    assert len(grid.configurations()) == 14
    jobs = {job.name: job for job in grid.jobs()}
    assert len(jobs) == 42
    assert jobs["gt-full-16/seed-2"].tests == dict.fromkeys(("fixed", "scaled"), grid.tests)
    assert grid.tests == tuple(range(4, 65, 4))
    assert jobs["mlp-8/seed-0"].tests == {"fixed": (8,), "scaled": (8,)}


def test_every_configuration_has_its_first_seed_before_any_has_its_second():
    seeds = [job.config.seed for job in Grid(seeds=2).jobs()]
    assert seeds == [0] * 14 + [1] * 14


def test_the_mlp_is_in_the_grid_once_for_each_length():
    names = [config.policy_name for config in Grid(models=("mlp", "gcn")).configurations()]
    assert names == [
        "mlp-8", "gcn-mixed-8", "gcn-full-8", "mlp-16", "gcn-mixed-16", "gcn-full-16",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"models": ("mlp",), "graphs": ("mixed",), "tests": (8,)},
            "no graph, got mixed",
        ),
        ({"models": ("mlp",), "graphs": (), "tests": (4, 8, 12)}, "got tests at 4, 12"),
        ({"models": ("gnc",)}, "unknown model .gnc.: choose one of mlp, gcn"),
        ({"graphs": ()}, "at least one graph"),
        ({"models": ("gcn", "gcn")}, "model gcn is in the grid twice"),
        ({"lengths": (8, 8)}, "length 8 is in the grid twice"),
        ({"lengths": (1,)}, "2 to 1024"),
        ({"tests": (8, 2000)}, "2 to 1024"),
        ({"seeds": 0}, "seeds must be 1 to"),
        ({"preset": "slow"}, "slow"),
        ({"steps": 0}, "steps must be positive"),
        ({"settings": ("ppo.gama=1",)}, "perhaps ppo.gamma"),
        ({"settings": ("ppo.gamma=2",)}, "gamma must lie in"),
        ({"settings": ("seed=2",)}, "a study has a setting seed of its own: give it as seeds"),
        ({"settings": ("mix.lengths=4,8",)}, "trained on one length"),
        ({"settings": ("control.improved=true",)}, "improved belongs to the model gcn"),
    ],
    ids=lambda v: str(v)[:40],
)
def test_a_grid_that_cannot_be_is_refused(values, words):
    with pytest.raises(InputError, match=words):
        Grid(**values).configurations()


def test_a_folder_keeps_its_grid_and_refuses_another(tmp_path):
    folder = tmp_path / "study"
    claim(folder, Grid(seeds=2))
    claim(folder, Grid(seeds=2))
    assert read_grid(folder) == Grid(seeds=2)
    with pytest.raises(InputError, match="another grid: seeds 2 there, 1 given"):
        claim(folder, Grid(seeds=1))
    with pytest.raises(InputError, match=r'models \["mlp", "gcn", "gatv2", "gt"\] there'):
        claim(folder, Grid(seeds=2, models=("gcn",)))


def test_settings_reach_every_run_and_belong_to_the_grid(tmp_path):
    changed = Grid(seeds=1, settings=("ppo.epochs=2", "task.tolerance=0.04"))
    for job in changed.jobs():
        assert (job.config.ppo.epochs, job.config.task.tolerance) == (2, 0.04)
    claim(tmp_path, changed)
    assert read_grid(tmp_path) == changed
    with pytest.raises(InputError, match="another grid: settings"):
        claim(tmp_path, Grid(seeds=1))


def test_a_grid_of_before_there_were_settings_is_one_without(tmp_path):
    claim(tmp_path, Grid(seeds=2))
    content = json.loads((tmp_path / "grid.json").read_text())
    del content["grid"]["settings"]
    (tmp_path / "grid.json").write_text(json.dumps(content))
    assert read_grid(tmp_path) == Grid(seeds=2)


def test_a_study_can_be_given_more_seeds_and_keeps_what_it_has(tmp_path):
    claim(tmp_path, Grid(seeds=2))
    check_folder(tmp_path, Grid(seeds=3))
    assert read_grid(tmp_path) == Grid(seeds=2)
    claim(tmp_path, Grid(seeds=3))
    assert read_grid(tmp_path) == Grid(seeds=3)
    assert Grid(seeds=3).jobs()[:28] == Grid(seeds=2).jobs()


def test_a_folder_with_something_else_in_it_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(InputError, match="holds something else"):
        claim(tmp_path, Grid())
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(InputError, match="is a file"):
        claim(tmp_path / "thesis.tex", Grid())


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "not valid JSON"),
        (json.dumps({"format": 99, "grid": {}}), "newer salpchain"),
        (json.dumps({"format": 1, "grid": {"colour": "red"}}), "does not describe a grid"),
        (json.dumps([]), "does not describe a grid"),
        (json.dumps({"format": "one", "grid": {}}), "does not describe a grid"),
        (json.dumps({"format": 1, "grid": {**asdict(Grid()), "foo": 1}}), "'foo' is unknown"),
        (json.dumps({"format": 1, "grid": {"preset": "quick"}}), "'graphs' is missing"),
    ],
)
def test_a_damaged_grid_is_refused(tmp_path, content, words):
    (tmp_path / "grid.json").write_text(content)
    with pytest.raises(InputError, match=words):
        read_grid(tmp_path)
