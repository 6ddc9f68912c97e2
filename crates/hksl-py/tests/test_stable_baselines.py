"""A client that knows nothing of hksl."""

import gymnasium
import hksl  # noqa: F401 (registers the tasks)
import numpy as np
import torch
from gymnasium.wrappers import ResizeObservation
from stable_baselines3 import SAC
from stable_baselines3.common.env_checker import check_env


def test_stable_baselines_trains_without_a_patch():
    # PyTorch's threads wait busily for each other where cores are shared.
    torch.set_num_threads(1)
    # Three frames are three channels, of which speeds can be told.
    env = ResizeObservation(gymnasium.make("hksl/falling-pixels-v0", frame_stack=3), (36, 36))
    assert env.observation_space.shape == (36, 36, 3)
    check_env(env)
    model = SAC(
        "CnnPolicy",
        env,
        buffer_size=1000,
        learning_starts=200,
        batch_size=8,
        policy_kwargs={"features_extractor_kwargs": {"features_dim": 32}, "net_arch": [32]},
        seed=1,
        device="cpu",
    )
    before = [parameter.detach().clone() for parameter in model.actor.parameters()]
    model.learn(300)
    assert model.num_timesteps == 300
    changed = zip(before, model.actor.parameters())
    assert any(not np.array_equal(old.numpy(), new.detach().numpy()) for old, new in changed)
    observation, _ = env.reset(seed=1)
    assert env.action_space.contains(model.predict(observation)[0])
