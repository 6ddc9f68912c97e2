"""What several tests share: environments that are quick, and settings that make runs short."""

import os
import signal

# Pendulum's renderer looks for a screen and for loudspeakers.
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("SDL_AUDIODRIVER", "dummy")

import gymnasium
import numpy as np
import pytest
import torch._dynamo  # noqa: F401 (before Mesa draws: see docs/python.md, PyTorch beside Mesa)
from gymnasium import spaces

# Shells start background jobs with SIGINT ignored, and Python then raises no KeyboardInterrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

# A run of a second: two evaluations of one episode, tiny networks.
SHORT = {
    "environment_steps": 160,
    "environment.action_repeat": 1,
    "evaluation": {"every_environment_steps": 80, "episodes": 1},
    "checkpoint.weights_every_environment_steps": 80,
}


@pytest.fixture
def runs(tmp_path):
    return tmp_path / "runs"


class Dot(gymnasium.Env):
    """A dot on a line, pushed by the action; ends when it leaves. Says what it was told."""

    metadata = {"render_modes": []}
    made: list["Dot"] = []

    def __init__(self, shape=(16, 16, 3), limit=20, action_space=None, observation_space=None):
        self.shape, self.limit = shape, limit
        self.observation_space = observation_space or spaces.Box(0, 255, shape, np.uint8)
        self.action_space = action_space or spaces.Box(-2.0, np.float32([2.0, 6.0]), (2,), np.float32)
        self.steps_per_episode = limit
        self.actions, self.seeds, self.closed = [], [], False
        self.place, self.steps = 8.0, 0
        Dot.made.append(self)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.seeds.append(seed)
        self.place, self.steps = float(self.np_random.uniform(6, 10)), 0
        return self.frame(), self.told()

    def step(self, action):
        self.actions.append(action)
        self.place += float(action[0])
        self.steps += 1
        terminated = not 0 <= self.place < 16
        return self.frame(), self.reward(), terminated, self.steps >= self.limit, self.told()

    def reward(self):
        return 1.0 - abs(self.place - 8) / 8

    def told(self):
        return {"place": self.place, "pair": np.array([self.place, self.steps]), "name": "dot"}

    def frame(self):
        frame = np.zeros(self.shape, np.uint8)
        column = int(np.clip(self.place, 0, 15))
        frame[..., column, :] = 255
        return frame

    def close(self):
        self.closed = True


@pytest.fixture
def dot():
    """The class, whose list of instances starts empty."""
    Dot.made = []
    return Dot


@pytest.fixture
def short():
    return dict(SHORT)
