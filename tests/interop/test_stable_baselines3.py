from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor

from salpchain.interop.stable_baselines3 import SalpVecEnv


def test_ppo_of_stable_baselines3_trains_and_improves():
    env = VecMonitor(SalpVecEnv(64, length=2, contact=False, fine_weight=0.5))
    ppo = PPO("MlpPolicy", env, n_steps=64, batch_size=1024, n_epochs=8, learning_rate=2e-3,
              gamma=0.95, seed=0, device="cpu", policy_kwargs={"net_arch": [32]})  # fmt: skip

    def closing():
        """Mean reward of a step over half an episode from fixed starts."""
        env.seed(9)
        obs, total = env.reset(), 0.0
        for _ in range(128):
            obs, reward, _, _ = env.step(ppo.predict(obs, deterministic=True)[0])
            total += reward.mean()
        return total

    before = closing()
    ppo.learn(64 * 64 * 6)
    after = closing()
    assert after > before + 0.1, (before, after)
