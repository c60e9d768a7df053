"""Fixed starts, the solutions that are known of them, and what may be added."""

import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from salpchain.cli.main import run
from salpchain.errors import InputError
from salpchain.evaluation.best import play, solutions, starts, table
from salpchain.evaluation.best.solutions import Solution
from salpchain.evaluation.turning import fewest_steps_turning
from salpchain.physics.state import Physics
from salpchain.tasks.config import GOAL_LIMIT, TaskConfig
from salpchain.tasks.reach.task import SCLD

SHORT = 2  # units of most tests here


@pytest.fixture
def folder(tmp_path):
    """A folder with the solutions of chains of two."""
    for name in (f"{SHORT}.safetensors", table.REFERENCE):
        shutil.copy(starts.FOLDER / name, tmp_path)
    return tmp_path


def offer(path, **fields):
    known = solutions.load(SHORT)[0]
    given = {"length": SHORT, "start": 0, "thrusts": known.newtons}
    np.savez(path, **{name: np.asarray(value) for name, value in (given | fields).items()})
    return str(path)


def test_the_stored_starts_are_those_that_the_task_draws():
    for length in (2, 32):
        drawn, stored = play._drawn(length), starts.load(length)
        for name in starts.Starts.__annotations__:
            np.testing.assert_allclose(getattr(drawn, name), getattr(stored, name), atol=1e-5)
        assert len(stored.angle) == starts.STARTS


def test_other_starts_are_refused(tmp_path):
    every = {length: starts.load(length) for length in starts.LENGTHS}
    every[3].position.flags.writeable = True
    moved = every | {3: starts.Starts(every[3].position + 0.01, every[3].angle, every[3].target)}
    starts.write(moved, tmp_path / starts.FILE)
    with pytest.raises(InputError, match="other starts than version 1"):
        starts.read(tmp_path / starts.FILE)


def test_solutions_come_back_from_their_file_as_they_were(tmp_path):
    random = np.random.default_rng(0)
    found = {
        number: Solution(random.integers(-127, 128, (5 + number, 4)).astype(np.int8), "me", "luck")
        for number in (0, 3, 99)
    }
    solutions.save(4, found, tmp_path)
    back = solutions.load(4, tmp_path)
    assert back.keys() == found.keys()
    for number, one in back.items():
        np.testing.assert_array_equal(one.thrusts, found[number].thrusts)
        assert (one.who, one.how) == ("me", "luck")


def test_only_what_is_better_is_kept(tmp_path):
    def found(steps):
        return {7: Solution(np.zeros((steps, 2), np.int8), str(steps), "-")}

    for steps, who in ((20, "20"), (21, "20"), (20, "20"), (19, "19")):
        solutions.keep(2, found(steps), tmp_path)
        assert solutions.load(2, tmp_path)[7].who == who


@pytest.mark.parametrize("length", starts.LENGTHS)
def test_no_solution_is_faster_than_the_bound_and_all_lie_within_the_time_limit(length):
    found, least = solutions.load(length), table.bounds(length)
    assert len(found) == starts.STARTS
    for number, one in found.items():
        assert least[number] <= one.steps <= max(512, 32 * length), number


def test_solutions_take_their_targets():
    places = [(length, number) for length in (2, 3, 4) for number in (0, 50, 99)]
    known = [solutions.load(length)[number] for length, number in places]
    steps = play.replay(places, [one.newtons for one in known]).steps
    assert (steps > 0).all() and (steps <= [one.steps for one in known]).all()


def test_solutions_hold_from_starts_a_hair_away_but_not_from_any():
    places = [(4, number) for number in range(8)]
    thrusts = [solutions.load(4)[number].newtons for number in range(8)]
    assert play.holds(places, thrusts).all()
    as_it_is = play.replay(places, thrusts).steps
    np.testing.assert_array_equal(play.replay(places, thrusts, moved=1e-7).steps, as_it_is)
    assert (play.replay(places, thrusts, moved=0.2).steps == 0).all()


def test_a_swim_that_would_miss_on_another_machine_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(play, "WOBBLE", 0.1)  # m: stands for a chain that chatters
    words = ["best", "--add", offer(tmp_path / "mine.npz"), "--who", "A", "--how", "by hand"]
    assert run([*words, "--folder", str(tmp_path)]) == 2
    told = capsys.readouterr().err
    assert "but not from each of 8 starts" in told and told.count("\n") == 1
    assert not (tmp_path / f"{SHORT}.safetensors").exists()


def test_a_replay_is_what_the_task_does():
    known, some = solutions.load(3)[5], starts.load(3)
    env = SCLD(TaskConfig(length=3))
    chain = jax.tree.map(lambda x: x[0], play.poses([(3, 5)], 3)[0])
    state = jax.jit(env.start)(chain, jnp.asarray(some.target[5]), jax.random.key(0))
    advance = jax.jit(env.step)
    for thrust in known.newtons:
        assert not bool(state.goal)
        state = advance(state, jnp.asarray(thrust)[:, None])
    assert bool(state.goal)
    least = fewest_steps_turning(Physics(), chain, state.target, GOAL_LIMIT, 512)
    assert int(least) == table.bounds(3)[5]


def test_what_falls_short_of_the_target_is_refused_with_how_near_it_came(tmp_path, capsys):
    known = solutions.load(SHORT)[0]
    path = offer(tmp_path / "mine.npz", thrusts=known.newtons[: known.steps // 2])
    words = ["best", "--add", path, "--who", "me", "--how", "half"]
    assert run(words) == 2
    said = capsys.readouterr().err
    assert "the target is not taken within" in said and said.count("\n") == 1


def test_a_better_solution_is_added_and_a_worse_one_is_not(folder, capsys):
    known = solutions.load(SHORT, folder)
    path = offer(folder / "mine.npz")
    words = ["best", "--folder", str(folder), "--add", path, "--who", "me", "--how", "by hand"]
    assert run(words) == 0
    assert "not kept" in capsys.readouterr().out
    slow = Solution(np.zeros((500, SHORT), np.int8), "nobody", "waiting")
    solutions.save(SHORT, known | {0: slow}, folder)
    assert run(words) == 0
    assert "500 were known: kept" in capsys.readouterr().out
    assert solutions.load(SHORT, folder)[0].who == "me"


def test_a_recorded_swim_can_be_added(folder):
    known = solutions.load(SHORT, folder)
    play.swim(SHORT, 0, known[0]).save(folder / "swim.npz")
    read = solutions.read_offer(folder / "swim.npz", "me", "recorded")
    assert (read.length, read.start) == (SHORT, 0)
    np.testing.assert_array_equal(read.solution.thrusts[: known[0].steps], known[0].thrusts)


WRONG = [
    ({"length": 5}, "length must be one of 2, 3, 4, 6, 8, 12, 16, 32 units, got 5"),
    ({"start": 100}, "start must be a whole number, 0 to 99, got 100"),
    ({"start": 0.5}, "start must be one whole number"),
    ({"thrusts": np.zeros((4, 3))}, "thrusts must be floats (step, 2), 1 to 512 steps"),
    ({"thrusts": np.full((4, 2), 1.5)}, "must be finite and lie in [-1, 1] N"),
    ({"thrusts": np.full((4, 2), np.nan)}, "must be finite"),
    ({"thrusts": np.zeros((600, 2))}, "1 to 512 steps, got float64 (600, 2)"),
]


@pytest.mark.parametrize(("fields", "expected"), WRONG)
def test_what_is_no_solution_is_refused_in_one_line(tmp_path, capsys, fields, expected):
    path = offer(tmp_path / "mine.npz", **fields)
    assert run(["best", "--add", path, "--who", "me", "--how", "chance"]) == 2
    said = capsys.readouterr().err
    assert expected in said and said.count("\n") == 1


def test_a_file_that_is_none_is_refused(tmp_path, capsys):
    (tmp_path / "text.npz").write_text("no archive")
    for name in ("text.npz", "nothing.npz"):
        assert run(["best", "--add", str(tmp_path / name), "--who", "a", "--how", "b"]) == 2
        assert capsys.readouterr().err.count("\n") == 1


BAD = [
    (["--who", "me"], "--who goes with --add"),
    (["--check", "--play", "2", "0"], "choose one of --check, --play, --add and --gaps"),
    (["--gaps"], "--gaps needs --out, a file that ends in .png"),
    (["--gaps", "--out", "gaps.pdf"], "--out must end in .png or .csv"),
    (["--out", "gaps.png"], "--out goes with --play or --gaps"),
    (["--play", "2", "0", "--lengths", "2"], "--lengths goes with the table, --check and --gaps"),
    (["--lengths", "5"], "length must be one of 2, 3, 4"),
    (["--play", "2"], "needs a length and the number of a start"),
    (["--play", "2", "100"], "start must be a whole number, 0 to 99, got 100"),
    (["--play", "2", "0", "--out", "swim.txt"], "--out must end in .png or"),
    (["--vmas"], "--vmas goes with --check"),
    (["--add", "mine.npz", "--how", "luck"], "--add needs --who"),
    (["--folder", "/nowhere"], "no such folder"),
]


@pytest.mark.parametrize(("words", "expected"), BAD)
def test_options_that_do_not_go_together_are_refused_in_one_line(capsys, words, expected):
    assert run(["best", *words]) == 2
    said = capsys.readouterr().err
    assert expected in said and said.count("\n") == 1


def test_the_table_has_a_line_for_each_length(folder, capsys):
    assert run(["best", "--folder", str(folder), "--lengths", "2,4"]) == 0
    two, four = [line.split() for line in capsys.readouterr().out.splitlines()[-2:]]
    assert two[:2] == ["2", "100"] and 0 < float(two[4]) <= 1 <= float(two[5])
    assert four == ["4", "0", "-", "-", "-", "-"]


def test_the_gaps_are_written_as_a_picture_and_as_a_table(folder, capsys):
    words = ["best", "--folder", str(folder), "--lengths", "2,4", "--gaps", "--out"]
    picture, csv = str(folder / "gaps.png"), str(folder / "gaps.csv")
    assert run([*words, picture]) == 0
    assert (folder / "gaps.png").read_bytes().startswith(b"\x89PNG")
    assert run([*words, csv]) == 0
    gaps, known = pd.read_csv(csv), solutions.load(SHORT, folder)
    assert (gaps["length"] == SHORT).all() and list(gaps["start"]) == list(known)
    assert list(gaps["best"]) == [known[start].steps for start in known]
    assert list(gaps["bound"]) == list(table.bounds(SHORT))
    missed = gaps["any_length"].isna()
    assert list(gaps["any_length"].fillna(0)) == table.reference(SHORT, folder)
    assert missed.sum() < len(gaps) / 2
    assert run([*words, csv]) == 2 and "--overwrite" in capsys.readouterr().err


def test_no_gaps_are_written_where_nothing_is_known(tmp_path, capsys):
    out = tmp_path / "gaps.png"
    assert run(["best", "--folder", str(tmp_path), "--gaps", "--out", str(out)]) == 2
    assert "no solution is known" in capsys.readouterr().err and not out.exists()


def test_the_check_finds_a_solution_that_is_none(folder, capsys):
    known = solutions.load(SHORT, folder)
    some = {number: known[number] for number in (0, 1)}
    some[1] = Solution(known[1].thrusts[:-6], "me", "cut short")
    solutions.save(SHORT, some, folder)
    assert run(["best", "--folder", str(folder), "--check", "--lengths", "2"]) == 1
    assert "1 of 2 in the engine, missed: 1" in capsys.readouterr().out


def test_a_solution_is_played_and_drawn(folder, capsys):
    out = folder / "swim.png"
    words = ["best", "--play", "2", "3", "--folder", str(folder), "--out", str(out)]
    assert run(words) == 0
    assert "goal reached after" in capsys.readouterr().out
    assert out.read_bytes().startswith(b"\x89PNG")
    assert run(words) == 2  # it is there


def test_the_steps_of_another_any_length_do_not_stay_beside_those_of_the_new_one(tmp_path):
    steps = list(range(100))
    for length in (2, 4):
        table.save_reference(length, steps, "first", tmp_path)
    assert table.refers_to(2, "first", tmp_path) and not table.refers_to(2, "second", tmp_path)
    table.save_reference(4, steps[::-1], "second", tmp_path)
    assert table.refers_to(4, "second", tmp_path) and not table.refers_to(2, "second", tmp_path)
    assert table.reference(4, tmp_path) == steps[::-1] and table.reference(2, tmp_path) == [0] * 100
