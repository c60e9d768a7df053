# pyright: strict
"""A program that uses every public name, for the type checker: it is read and never run."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import reveal_type

import jax

import salpchain

reveal_type(salpchain.use_cache())
try:
    policy = salpchain.load("any-length")
except salpchain.InputError as error:
    raise SystemExit(str(error)) from None
reveal_type(policy)
reveal_type(policy.card.task(length=24))

env = salpchain.SCLD(salpchain.TaskConfig(length=8), salpchain.Physics())
state: salpchain.State = env.reset(jax.random.key(0))
chain: salpchain.Chain = state.chain
bodies: salpchain.Bodies = chain.units
reveal_type(env)
reveal_type(env.step(state, policy.act(state)))
reveal_type(state.closed_fraction)
reveal_type(state.obs)
reveal_type(state.reward)
reveal_type(chain.present)
reveal_type(bodies.position)
written: list[salpchain.Controller] = [salpchain.Greedy(), salpchain.Approach(), salpchain.MPC()]
reveal_type(written[0].act(state))
reveal_type(salpchain.MPC.guided(policy))
steer = salpchain.steering(policy, length=8)
reveal_type(steer)


class Hover(salpchain.Task):
    """A task of one's own."""

    def begin(
        self, key: jax.Array, draw_key: jax.Array, length: int | jax.Array,
        physics: salpchain.Physics,
    ) -> salpchain.Start:  # fmt: skip
        chain = self.spawn(draw_key, length, physics)
        return salpchain.Start(chain, chain.units.position)


speed = salpchain.scalar_feature("speed", "m/s", lambda view: view.root(view.velocity[0] ** 2))
seen: tuple[salpchain.Feature, ...] = (
    *salpchain.OBSERVATIONS["proximity"],
    salpchain.vector_feature("velocity", "m/s", lambda view: view.velocity),
    speed,
)
rough = salpchain.WorldConfig(
    dynamics=salpchain.DynamicsConfig(mass=salpchain.Range(0.8, 1.2)),
    current=salpchain.CurrentConfig(speed=salpchain.Range(0.0, 0.05)),
    thrusters=salpchain.ThrusterConfig(one_sided=True),
    sensing=salpchain.SensingConfig(),
    obstacles=salpchain.ObstacleConfig(),
)
reveal_type(Hover(world=rough).world)
reveal_type(salpchain.make_task(salpchain.FollowConfig(speed=0.1), salpchain.World()))
reveal_type(salpchain.renew_done(env, jax.vmap(env.reset)(jax.random.split(jax.random.key(0)))))
reveal_type(salpchain.PolicyCard(name="mine"))
reveal_type(salpchain.Judgement(state.terms, state.terminated))
reveal_type(bodies.heading)

config = salpchain.TrainConfig(
    control=salpchain.ControlConfig(model="gt"),
    ppo=salpchain.PPOConfig(learning_rate=1e-3),
    mix=salpchain.Mix((4, 8)),
    seed=1,
)
reveal_type(replace(config, steps=1000))
reveal_type(config.ppo.learning_rate)
reveal_type(salpchain.preset("quick", length=8, settings={"ppo.learning_rate": 1e-3}))


def log(metrics: Mapping[str, float], step: int) -> None:
    print(step, metrics.get("success"))


reveal_type(salpchain.train(config, "runs/one", on_iteration=[log, lambda metrics, step: None]))
reveal_type(salpchain.resume(Path("runs/one")))

learner: salpchain.Learner = salpchain.new_learner(config, devices=1)
learner, metrics = salpchain.iterate(learner)
reveal_type(metrics["update_value"])
reveal_type(learner.policy)
reveal_type(learner.steps)
reveal_type(salpchain.identity(policy))
reveal_type(salpchain.evaluate(policy, [8, 16], 20, "scaled", 0, "results"))
reveal_type(salpchain.run_suite(policy, "sea", [8], 4, "scaled", 0, Path("results")))
(swim,) = salpchain.record(policy, [8])
reveal_type(swim)
reveal_type(swim.unit_position)
swim.save("swim.npz")
reveal_type(salpchain.Trajectory.load("swim.npz"))
if isinstance(policy, salpchain.Policy):
    salpchain.save_policy(policy, Path("policy.safetensors"))
    reveal_type(policy.network)
