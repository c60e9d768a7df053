"""A few iterations of BenchMARL's MAPPO on the VMAS scenario."""

import torch
from benchmarl.algorithms import MappoConfig
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig

from salpchain.interop.benchmarl import benchmarl_task

torch.set_num_threads(1)


def test_mappo_trains_a_few_iterations(tmp_path):
    config = ExperimentConfig.get_from_yaml()
    config.loggers, config.create_json, config.save_folder = [], False, str(tmp_path)
    config.evaluation = config.render = False
    config.max_n_frames, config.max_n_iters = None, 3
    config.on_policy_collected_frames_per_batch = 400
    config.on_policy_n_envs_per_worker = 20
    config.on_policy_n_minibatch_iters, config.on_policy_minibatch_size = 2, 200
    model = MlpConfig(num_cells=[16], activation_class=torch.nn.Tanh, layer_class=torch.nn.Linear)
    experiment = Experiment(
        task=benchmarl_task(length=2, max_steps=10), algorithm_config=MappoConfig.get_from_yaml(),
        model_config=model, critic_model_config=model, seed=0, config=config,
    )  # fmt: skip
    before = [p.clone() for p in experiment.losses["unit"].parameters()]
    experiment.run()
    assert experiment.n_iters_performed == 3 and experiment.total_frames == 1200
    assert abs(experiment.mean_return) < 10
    after = experiment.losses["unit"].parameters()
    assert any((old != new).any() for old, new in zip(before, after, strict=True))
    steps = experiment.test_env.rollout(12, break_when_any_done=False)["next"]
    assert steps["truncated"][:, 9].all() and not steps["terminated"].any()
