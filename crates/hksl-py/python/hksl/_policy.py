"""Trained policies."""

from __future__ import annotations

from pathlib import Path
from typing import Optional

import numpy as np

from . import _native
from ._training import PathLike


class Policy:
    """A run's policy and encoders. `hksl.load` opens one.

    An observation is a stack of `frame_stack` frames, oldest first, `uint8`; at an episode's start, the first frame is
    repeated. Its axes may be `(stack·C, H, W)`, `(H, W, stack·C)`, `(stack, C, H, W)` or `(stack, H, W, C)`: what
    `gymnasium.wrappers.FrameStackObservation` makes, and what `hksl/…` environments return with `frame_stack=`. The
    first of these that fits the shape is taken.
    """

    def __init__(self, native: _native.Policy):
        self._native = native

    def act(self, observation: np.ndarray, *, deterministic: bool = True) -> np.ndarray:
        """Chooses an action for one observation: `float32`, in the bounds and shape of the environment's actions.

        By default it is the policy's mean, as in evaluations; else a sample.
        """
        return self._native.act(np.asarray(observation), not deterministic)

    def encode(self, observations: np.ndarray) -> dict[str, np.ndarray]:
        """The latents of each encoder by its name, `(B, Z)` `float32`, for a batch of observations."""
        return self._native.encode(np.asarray(observations))

    def reset(self) -> None:
        """Begins an episode. Only recurrent policies (dreamer-v2) need it."""
        self._native.reset()

    def export(self, file: PathLike) -> None:
        """Writes the weights to a safetensors file, with what is needed to rebuild the policy in its metadata."""
        self._native.export(Path(file))

    @property
    def observation_shape(self) -> tuple[int, int, int]:
        """Shape of an observation, `(stack·C, H, W)`."""
        channels, height, width = self._native.observation_shape
        return channels, height, width

    @property
    def frame_shape(self) -> tuple[int, int, int]:
        """Shape of a single frame, `(C, H, W)`."""
        channels, height, width = self._native.frame_shape
        return channels, height, width

    @property
    def frame_stack(self) -> int:
        """Frames in an observation."""
        return self._native.frame_stack

    @property
    def action_shape(self) -> tuple[int, ...]:
        """Shape of an action."""
        return tuple(self._native.action_shape)

    @property
    def environment_step(self) -> int:
        """Environment step of the checkpoint."""
        return self._native.environment_step

    @property
    def method(self) -> str:
        """Method of the run."""
        return self._native.method

    @property
    def task(self) -> str:
        """Task of the run, with its distractor."""
        return self._native.task

    def __repr__(self) -> str:
        return f"<hksl.Policy of {self.method} on {self.task} at environment step {self.environment_step:,}>"


def load(run: PathLike, *, checkpoint: Optional[int] = None, device: str = "auto") -> Policy:
    """Opens the policy of a run's folder, or of a folder that `Agent.save` wrote. Only weights are read.

    Parameters
    ----------
    run
        Folder of a run, of `hksl.train` or of the command line. It may still be training.
    checkpoint
        Environment step of the checkpoint; by default the newest.
    device
        `auto`, `cpu`, `cuda` or `cuda:N`.
    """
    return Policy(_native.Policy(Path(run), checkpoint, device))


