"""Public functions given what they do not take; run by `test_public_arguments` as a program.

A program of its own, for in the tests types are checked before a function sees what it is given.
Work is replaced by an exception: what reaches it was accepted. Prints JSON: the outcome of each
call of each part.
"""

import json
import os
import sys
import tempfile
import warnings
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np

import salpchain
import salpchain.controllers.steering as poses
import salpchain.evaluation.evaluate as testing
import salpchain.evaluation.recording as recording
import salpchain.training.loop as loop
import salpchain.training.trainer as training
from salpchain import devices  # noqa: F401 - SEEN uses it
from salpchain.evaluation import kept  # noqa: F401 - SEEN uses it
from salpchain.interop import steer
from salpchain.interop.export import export
from salpchain.report import figures, picture, replay, video
from salpchain.report.picture import chains_picture
from salpchain.report.replay import write_replay
from salpchain.report.video import Film, write_video
from salpchain.training import run_folder


class Reached(Exception):  # noqa: N818 - it is no error
    """The arguments were accepted, and the work would begin."""


def work(*given, **named):
    raise Reached


testing._play = recording._begin = poses._play = work
training._create = training.Session = loop._Program = work
picture.Figure = replay.page = video.frames = figures.Figure = figures.transfer_figure = work


def ones(abstract):
    """Arrays of these shapes, without compiling what would make them."""

    def made(x):
        if jnp.issubdtype(x.dtype, jax.dtypes.prng_key):
            return jr.wrap_key_data(jnp.asarray(np.ones((*x.shape, 2), np.uint32)))
        return jnp.asarray(np.ones(x.shape, x.dtype))

    return jax.tree.map(made, abstract)


def swim():
    points, angles = np.zeros((2, 2, 2)), np.zeros((2, 2))
    bodies = {"position": points, "angle": angles, "velocity": points, "angular_velocity": angles}
    return {
        **{f"unit_{name}": array for name, array in bodies.items()},
        **{f"link_{name}": array[:, :1] for name, array in bodies.items()},
        "policy": "p", "seed": 0, "trial": 0, "time_limit": "fixed", "length": 2, "dt": 0.1,
        "success": False, "thrust": np.zeros((1, 2)), "reward": np.zeros(1),
        "target": np.zeros((2, 2)),
    }  # fmt: skip


def traced(function):
    """The function, traced: nothing is compiled."""

    def call(**given):
        jax.eval_shape(lambda: (function(**given), None)[1])

    return call


POLICY, CONFIG = salpchain.load("any-length"), salpchain.preset("quick")
ENV, KEY = salpchain.SCLD(POLICY.card.task(3)), jr.key(0)
STATE = ones(jax.eval_shape(ENV.reset, KEY))
BATCH = ones(jax.eval_shape(jax.vmap(ENV.reset), jr.split(KEY, 2)))
OTHER = ones(jax.eval_shape(salpchain.SCLD(POLICY.card.task(4)).reset, KEY))
MPC = salpchain.MPC()
PLAN = ones(jax.eval_shape(MPC.begin, STATE))
SWIM = salpchain.Trajectory(**swim())
LEARNER = salpchain.Learner(CONFIG, CONFIG.iterations - 1, STATE, SimpleNamespace(run=work))
STEER = salpchain.steering(POLICY, 3)
ROBOT = {name: np.ones((3, 2)) for name in ("position", "velocity", "target", "force")}
ROBOT |= {name: np.ones(3) for name in ("angle", "angular_velocity")}
RUN = {"run": "run", "on_iteration": print, "on_stage": None, "save_every": 20.0, "devices": None}
STARTS = {"lengths": [3], "time_limit": "fixed", "seed": 0}
FLAGS = {"out": None, "baseline": True, "progress": None, "overwrite": False}

PLACE = {"task": "reach", "world": "still"}
ROUGH = salpchain.preset(world="rough").world
PARTS = ("dynamics", "current", "thrusters", "sensing", "obstacles")

# Each function with arguments that are right
GOOD = {
    "load": (salpchain.load, {"source": "greedy"}),
    "evaluate": (
        salpchain.evaluate,
        {"controller": POLICY, "trials": 2, **STARTS, **FLAGS, **PLACE},
    ),
    "run_suite": (
        salpchain.run_suite,
        {
            "controller": POLICY,
            "name": "sea",
            "trials": 2,
            **STARTS,
            "out": None,
            "progress": None,
            "overwrite": False,
        },
    ),
    "record": (salpchain.record, {"controller": POLICY, **STARTS, "trial": 0, **PLACE}),
    "train": (salpchain.train, {"config": CONFIG, **RUN, **PLACE}),
    "resume": (salpchain.resume, {**RUN, "run": "begun"}),
    "new_learner": (salpchain.new_learner, {"config": CONFIG, "devices": None, **PLACE}),
    "iterate": (salpchain.iterate, {"learner": LEARNER}),
    "preset": (
        salpchain.preset,
        {"name": "quick", "length": 3, "model": "gcn", "graph": "mixed", "seed": 0, "settings": {}},
    ),
    "steering": (salpchain.steering, {"controller": POLICY, "length": 3}),
    "steer": (STEER, ROBOT),
    "steer.thrust": (STEER.thrust, ROBOT),
    "identity": (salpchain.identity, {"controller": salpchain.Greedy()}),
    "save_policy": (salpchain.save_policy, {"policy": POLICY, "path": "p", "half": False}),
    "SCLD": (salpchain.SCLD, {"config": ENV.config, "world": ENV.world}),
    "Task": (salpchain.Task, {"config": ENV.config, "world": "still"}),
    "make_task": (salpchain.make_task, {"config": salpchain.FollowConfig(), "world": None}),
    "Feature": (salpchain.Feature, dict(vars(salpchain.OBSERVATIONS["around"][-1]))),
    "scalar_feature": (
        salpchain.scalar_feature,
        {"name": "x", "unit": "m", "row": len, "frame": "none", "senses": ""},
    ),
    "vector_feature": (
        salpchain.vector_feature,
        {"name": "x", "unit": "m", "rows": len, "frame": "world", "senses": "water"},
    ),
    "env.reset": (traced(ENV.reset), {"key": KEY, "length": 3}),
    "env.start": (
        traced(ENV.start),
        {"chain": STATE.chain, "target": np.zeros((3, 2)), "key": KEY},
    ),
    "env.step": (traced(ENV.step), {"state": STATE, "action": np.zeros((3, 1))}),
    "env.observe": (
        traced(ENV.observe),
        {"chain": STATE.chain, "target": np.zeros((3, 2)), "force": np.zeros((3, 2))},
    ),
    "env.thrust": (traced(ENV.thrust), {"chain": STATE.chain, "action": np.zeros((3, 1))}),
    "env.step_limit": (ENV.step_limit, {"length": 3}),
    "renew_done": (traced(salpchain.renew_done), {"env": ENV, "states": BATCH}),
    "policy.act": (traced(POLICY.act), {"state": STATE, "graph": None}),
    "card.task": (POLICY.card.task, {"length": 3, "time_limit": "fixed", "contact": True}),
    "card.check_serves": (POLICY.card.check_serves, {"length": 3}),
    "greedy.act": (traced(salpchain.Greedy().act), {"state": STATE}),
    "approach.act": (traced(salpchain.Approach().act), {"state": STATE}),
    "mpc.begin": (traced(MPC.begin), {"state": STATE}),
    "mpc.plan": (traced(MPC.plan), {"state": STATE, "plan": PLAN}),
    "MPC.guided": (salpchain.MPC.guided, {"guide": POLICY}),
    "Trajectory": (salpchain.Trajectory, swim()),
    "Trajectory.load": (salpchain.Trajectory.load, {"path": "swim.npz"}),
    "trajectory.save": (salpchain.Trajectory(**swim()).save, {"path": "swim.npz"}),
    "write_video": (
        write_video,
        {"swims": [SWIM], "out": "swim.gif", "film": None, "progress": print},
    ),
    "write_replay": (write_replay, {"swims": [SWIM], "out": "swim.html"}),
    "chains_picture": (chains_picture, {"swims": [SWIM], "out": "swim.png", "rows": None}),
    "learning_curves": (figures.learning_curves, {"runs": ["begun"], "out": "l.png", "window": 10}),
    "zero_shot": (figures.zero_shot, {"evaluations": ["kept"], "out": "z.png"}),
    "export": (export, {"policy": salpchain.Greedy(), "path": "p.onnx", "kind": "onnx"}),
    "interop.steer.steering": (steer.steering, {"policy": POLICY, "length": 3}),
    **{
        type(own).__name__: (type(own), dict(vars(own)))
        for own in (
            *(CONFIG, CONFIG.task, CONFIG.control, CONFIG.ppo, salpchain.Mix((3, 4), (1.0, 1.0))),
            *(salpchain.FollowConfig(), ENV.world, ROUGH, *(vars(ROUGH)[part] for part in PARTS)),
            *(ENV.physics, MPC, Film(), salpchain.Greedy(), salpchain.Approach(), POLICY.card),
        )
    },
}

# What somebody might give instead
BAD = {
    "a name": "a",
    "an empty text": "",
    "a text with a zero": "a\0b",
    "a number": 3,
    "a fraction": 2.5,
    "a negative number": -1,
    "NaN": float("nan"),
    "True": True,
    "None": None,
    "a list": [3],
    "a mixed list": [3, "a", None],
    "a dict": {},
    "a Path of nothing": Path("nothing"),
    "bytes": b"x",
    "an array": np.ones((2, 3)),
    "an array without axes": np.array(2.5),
    "a state": STATE,
    "a batch": BATCH,
    "a policy": POLICY,
    "an object": object(),
    "a class": salpchain.Greedy,
}

# Calls that were seen to fail, as one would write them
SEEN = """
salpchain.evaluate("any-length", [3], 2)
salpchain.evaluate("any-length", "3..5", 2)
salpchain.evaluate(POLICY, 8)
salpchain.evaluate(POLICY, range(3, 9))
salpchain.evaluate(POLICY, np.arange(3, 9), np.int64(2))
salpchain.evaluate(POLICY, [3], 2.0)
salpchain.evaluate(POLICY, [])
salpchain.evaluate(salpchain.Greedy, 3)
salpchain.evaluate(POLICY, [3], time_limit="short", out="never")
salpchain.record("any-length", [3])
salpchain.record(POLICY, 3)
salpchain.record(Path("nothing"), 3)
salpchain.train({}, "q")
salpchain.train(CONFIG, None)
salpchain.train(CONFIG, "never", devices=0)
salpchain.load(None)
salpchain.load(3)
salpchain.load("")
salpchain.preset(None)
salpchain.record(POLICY, None)
salpchain.record(POLICY, 3, seed=1.5)
salpchain.load("a" * 5000)
salpchain.preset("quick", settings=["steps"])
salpchain.preset(steps=10)
salpchain.preset(stepz=10)
salpchain.preset(length="4..6")
salpchain.preset(length=np.int64(4))
salpchain.Mix([4, 8])
POLICY.card.task(3, foo=1)
POLICY.card.task(3, observation="body")
POLICY.card.task(3, observation=POLICY.card.observation)
salpchain.Trajectory(**swim()).save("missing/swim.npz")
salpchain.Trajectory(**swim()).save(".")
traced(salpchain.renew_done)(env=ENV, states=STATE)
traced(ENV.step)(state=OTHER, action=np.zeros((3, 1)))
traced(ENV.step)(state=STATE, action=[[0.5], [0], [-0.5]])
traced(ENV.step)(state=STATE, action=[[0.5], [0, 1], [-0.5]])
traced(ENV.start)(chain=STATE.chain, target=[[0, 1], [0, 2], [0, 3]], key=KEY)
STEER(**{**ROBOT, "angle": "a"})
STEER(**{**ROBOT, "angle": [0, 0, 0], "force": None})
jax.jit(lambda angle: STEER(**{**ROBOT, "angle": angle}))(np.ones(3))
devices.use_devices(1000)
run_folder.check_free(".")
kept.check_kept("kept", "other", "1", {})
"""


def outcome(call):
    """What became of a call, and whether it left a file where it was refused."""
    before = sorted(Path().rglob("*"))
    try:
        call()
    except Reached:
        return "accepted"
    except salpchain.InputError as error:
        left = sorted(Path().rglob("*")) != before
        return f"{'left files: ' if left else ''}refused: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "accepted"


def sweep(functions=GOOD):
    """Each argument of each function, in turn, replaced by each wrong value."""
    for name, (function, good) in functions.items():
        for argument in good:
            for what, bad in BAD.items():
                given = {**good, argument: bad}
                call = f"{name}({argument}={what})"
                yield call, outcome(lambda given=given, function=function: function(**given))


def seen():
    for call in SEEN.strip().splitlines():
        yield call, outcome(lambda call=call: eval(call))


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # of JAX, about what it is given here
    os.chdir(tempfile.mkdtemp())
    Path("kept").mkdir()
    run_folder.create("begun", CONFIG, 1, "cpu")
    Path("kept/evaluation.json").write_text('{"policy": "one", "identity": "2", "lengths": []}')
    from tests.interop.arguments import functions

    parts = {"seen": seen(), "sweep": sweep(), "bridges": sweep(functions(BATCH, STATE, work))}
    print(json.dumps(dict(parts[sys.argv[1]])))
