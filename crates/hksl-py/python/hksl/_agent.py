"""Agents for training loops of one's own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Optional

import numpy as np

from . import _native
from ._arguments import Config, Presets, arguments
from ._training import PathLike


class Agent:
    """An agent with its replay, for a training loop of your own.

    ::

        observation, _ = env.reset()
        agent.begin(observation)
        while True:
            action = agent.act(observation)
            losses = agent.update()
            observation, reward, terminated, truncated, _ = env.step(action)
            agent.observe(action, reward, observation, terminated, truncated)
            if terminated or truncated:
                observation, _ = env.reset()
                agent.begin(observation)

    Observations are stacks of frames as `Policy` reads them; actions are `float32` of shape `(action_dims,)` in [-1, 1].

    Parameters
    ----------
    method
        `hksl` by default; `hksl.methods()` lists all.
    observation_shape
        `(stack·C, H, W)`; the stack is the setting `environment.frame_stack`, 3 by default.
    action_dims
        Numbers in an action.
    config, preset, seed, device, threads
        As for `hksl.train`.

    One thread at a time may use an agent; another gets `BusyError`, and nothing changes.
    """

    def __init__(
        self,
        method: Optional[str] = None,
        *,
        observation_shape: Sequence[int],
        action_dims: int,
        config: Optional[Config] = None,
        preset: Presets = (),
        seed: Optional[int] = None,
        device: Optional[str] = None,
        threads: Optional[int] = None,
    ):
        given = arguments(
            method=method, config=config, preset=preset, seed=seed, device=device, threads=threads
        )
        self._native = _native.Agent(given, list(observation_shape), action_dims)

    def begin(self, observation: np.ndarray) -> None:
        """Begins an episode with its first observation, which repeats the first frame."""
        self._native.begin(np.asarray(observation))

    def act(self, observation: np.ndarray, *, explore: bool = True) -> np.ndarray:
        """Chooses an action.

        To explore, it is uniformly random for the first `training.initial_random_steps` transitions, then sampled from
        the policy. Without exploring, it is the policy's mean.
        """
        return self._native.act(np.asarray(observation), explore)

    def observe(
        self,
        action: np.ndarray,
        reward: float,
        next_observation: np.ndarray,
        terminated: bool,
        truncated: bool,
    ) -> None:
        """Stores a transition: the action, its reward, and the observation that it led to.

        `terminated` means that nothing of value follows; time limits are `truncated`.
        """
        self._native.observe(
            np.asarray(action, dtype=np.float32),
            float(reward),
            np.asarray(next_observation),
            bool(terminated),
            bool(truncated),
        )

    def update(self) -> Optional[dict[str, float]]:
        """Takes a learning step and returns its losses by name.

        None during the initial random steps, if no step is due, or while no finished episode is long enough to sample.
        """
        return self._native.update()

    def save(self, folder: PathLike) -> None:
        """Saves weights, optimisers, replay and random numbers. `hksl.load` can open the folder too."""
        self._native.save(Path(folder))

    def load(self, folder: PathLike) -> None:
        """Restores the newest save. An episode that was running has ended: begin a new one."""
        self._native.load(Path(folder))

    @property
    def agent_step(self) -> int:
        """Transitions observed."""
        return self._native.agent_step

    @property
    def updates(self) -> int:
        """Learning steps taken."""
        return self._native.updates

    @property
    def observation_shape(self) -> tuple[int, int, int]:
        """Shape of an observation, `(stack·C, H, W)`."""
        channels, height, width = self._native.observation_shape
        return channels, height, width

    @property
    def action_dims(self) -> int:
        """Numbers in an action."""
        return self._native.action_dims

    @property
    def settings(self) -> str:
        """All settings, as TOML."""
        return self._native.config()
