"""hksl's tasks as Gymnasium environments."""

from __future__ import annotations

import threading
from typing import Any, Literal, Optional

import gymnasium
import numpy as np
from gymnasium import spaces

from . import _native
from ._arguments import Config, Presets, arguments
from .errors import BusyError, ConfigError, TaskError

__all__ = ["HkslEnv", "register", "tasks"]


class HkslEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A task of hksl, as `hksl train` trains in it: the same frames, action repeat and episode length.

    `gymnasium.make("hksl/cartpole-swingup-v0", distractor="color-easy")` makes one.

    Parameters
    ----------
    task
        Name of the task, as `hksl tasks` lists it.
    distractor
        `color-easy` … `camera-hard`, for control tasks; `none` by default.
    frame_stack
        Frames that form one observation, oldest first; 1 by default, a single frame. `hksl.load(run).frame_stack` is
        what a policy expects, 3 by default.
    channels_last
        Whether observations are `(height, width, channels)`, the default, or `(channels, height, width)`. A stack has
        `frame_stack` times the channels of a frame.
    preset, config
        Presets and settings by dotted key, as for `hksl.train`: `{"environment.action_repeat": 1}`.
    render_mode
        `rgb_array` or None.

    Observations are `uint8`. Actions are `float32` in [-1, 1]. Time limits truncate. `info` has the ground truth of the
    state by name: numbers, and arrays in SI units. An instance belongs to the thread that made it.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        task: str,
        *,
        distractor: Optional[str] = None,
        frame_stack: int = 1,
        channels_last: bool = True,
        preset: Presets = (),
        config: Optional[Config] = None,
        render_mode: Optional[Literal["rgb_array"]] = None,
    ):
        if render_mode not in (None, "rgb_array"):
            raise ConfigError(f"render_mode = {render_mode!r} is not valid; expected 'rgb_array' or None")
        if not isinstance(frame_stack, int) or frame_stack < 1:
            raise ConfigError(f"frame_stack = {frame_stack!r} is not valid; expected a whole number of at least 1")
        given = arguments(task=task, distractor=distractor, preset=preset, config=config)
        native = _native.Environment(given, channels_last)
        self._native: Optional[_native.Environment] = native
        self._thread = threading.get_ident()
        self._channels_last = channels_last
        self._stack = frame_stack
        self._frames: list[np.ndarray] = []
        self._seeded = False
        self._over = True
        self._frame: Optional[np.ndarray] = None
        self.render_mode = render_mode
        self.task = task
        milliseconds = native.step_milliseconds
        if milliseconds:
            self.metadata = {**self.metadata, "render_fps": max(1, round(1000 / milliseconds))}
        #: Agent steps after which an episode is truncated.
        self.steps_per_episode: int = native.steps_per_episode
        channels, height, width = native.frame_shape
        stacked = channels * frame_stack
        shape = (height, width, stacked) if channels_last else (stacked, height, width)
        self.observation_space = spaces.Box(0, 255, shape, np.uint8)
        self.action_space = spaces.Box(-1.0, 1.0, (native.action_dims,), np.float32)

    def reset(
        self, *, seed: Optional[int] = None, options: Optional[dict[str, Any]] = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Starts an episode. A seed restarts the random numbers: a run with this seed trains on the same episodes."""
        super().reset(seed=seed)
        native = self._own()
        if seed is None and not self._seeded:
            seed = int(self.np_random.integers(2**31))
        if seed is not None:
            native.seed(seed)
            self._seeded = True
        frame = native.reset()
        self._frames = [frame] * self._stack
        self._frame, self._over = frame, False
        return self._observation(frame), native.readings()

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Takes one agent step: the action is repeated as the task's settings say, and rewards are summed."""
        native = self._own()
        if self._over:
            raise TaskError("step() before reset(), or after the end of an episode; call reset() first")
        frame, reward, terminated, truncated = native.step(np.asarray(action, dtype=np.float32))
        self._frame, self._over = frame, terminated or truncated
        return self._observation(frame), reward, terminated, truncated, native.readings()

    def render(self) -> Optional[np.ndarray]:
        """The current frame as `(height, width, 3)`, with `render_mode="rgb_array"`."""
        if self.render_mode is None:
            return None
        self._own()
        if self._frame is None:
            raise TaskError("render() before the first reset(); call reset() first")
        frame = self._frame if self._channels_last else np.moveaxis(self._frame, 0, -1)
        return np.ascontiguousarray(np.broadcast_to(frame, (*frame.shape[:2], 3)))

    def close(self) -> None:
        """Frees the simulation and its renderer."""
        if self._native is not None and self._thread == threading.get_ident():
            self._native.close()
            self._native = None

    def _own(self) -> _native.Environment:
        if self._native is None:
            raise TaskError(f"the environment {self.task} is closed; make a new one")
        if self._thread != threading.get_ident():
            raise BusyError(
                f"the environment {self.task} belongs to the thread that made it, like its renderer; make one in each "
                "thread"
            )
        return self._native

    def _observation(self, frame: np.ndarray) -> np.ndarray:
        if self._stack == 1:
            return frame
        self._frames = [*self._frames[1:], frame]
        return np.concatenate(self._frames, axis=-1 if self._channels_last else 0)


def tasks() -> list[str]:
    """The names of the tasks."""
    return [name for name, _, available in _native.tasks() if available]


def register() -> None:
    """Registers each task as `hksl/<task>-v0`. `import hksl` has done so."""
    for task in tasks():
        name = f"hksl/{task}-v0"
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point="hksl.envs:HkslEnv", kwargs={"task": task})
