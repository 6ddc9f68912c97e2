"""Gymnasium's environments as the extension module steps them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any, Optional

import gymnasium
import numpy as np

from .errors import ConfigError, TaskError

AnyEnv = gymnasium.Env[Any, Any]
EnvironmentFactory = Callable[[], AnyEnv]


class Bridge:
    """An environment whose actions arrive flat as float64, and whose observations leave as arrays."""

    def __init__(self, env: AnyEnv, readings: Sequence[str]):
        self._env = env
        self._readings = readings
        self._dtype = env.action_space.dtype
        self._shape = env.action_space.shape

    def reset(self, seed: int) -> tuple[np.ndarray, list[np.ndarray]]:
        result = self._env.reset(seed=seed)
        if not isinstance(result, tuple) or len(result) != 2:
            raise TaskError(
                f"reset() of the environment returned {type(result).__name__}; expected (observation, info), as "
                "Gymnasium defines it"
            )
        observation, info = result
        return np.asarray(observation), self._read(info)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, list[np.ndarray]]:
        result = self._env.step(action.astype(self._dtype).reshape(self._shape))
        if not isinstance(result, tuple) or len(result) != 5:
            raise TaskError(
                "step() of the environment did not return (observation, reward, terminated, truncated, info), as "
                "Gymnasium defines it"
            )
        observation, reward, terminated, truncated, info = result
        return np.asarray(observation), float(reward), bool(terminated), bool(truncated), self._read(info)

    def close(self) -> None:
        self._env.close()

    def _read(self, info: dict[str, Any]) -> list[np.ndarray]:
        values = []
        for key in self._readings:
            if key not in info:
                raise ConfigError(
                    f"info has no key {key!r}; it has {', '.join(map(repr, sorted(info))) or 'none'}. Name keys that "
                    "reset() and step() both return"
                )
            try:
                values.append(np.asarray(info[key], dtype=np.float64).reshape(-1))
            except (TypeError, ValueError):
                raise ConfigError(
                    f"info[{key!r}] = {info[key]!r} is not numeric; name keys that hold numbers or arrays of them"
                ) from None
        return values


class Brought:
    """What the extension module needs to know of a factory of environments. The first environment is made at once."""

    def __init__(self, factory: EnvironmentFactory, task: Optional[str], readings: Sequence[str]):
        if isinstance(factory, gymnasium.Env) or not callable(factory):
            raise ConfigError(
                f"environment is {type(factory).__name__}, not a function that makes one; pass a function such as "
                'lambda: gymnasium.make("MyTask-v0"), because evaluations use environments of their own'
            )
        self._factory = factory
        self.readings = list(readings)
        self._first: Optional[AnyEnv] = self._make()
        env = self._first
        self.task = task if task is not None else _name(env)
        self.observation_space = _declared(env.observation_space)
        self.action_space = _declared(env.action_space)
        self.episode_steps = _time_limit(env)

    def make(self) -> Bridge:
        """A new environment; the first time, the one that was looked at."""
        env, self._first = self._first or self._make(), None
        return Bridge(env, self.readings)

    def close(self) -> None:
        """Closes an environment that was looked at and not used."""
        if self._first is not None:
            env, self._first = self._first, None
            env.close()

    def _make(self) -> AnyEnv:
        env = self._factory()
        missing = [
            name
            for name in ("reset", "step", "close", "action_space", "observation_space")
            if not hasattr(env, name)
        ]
        if missing:
            raise ConfigError(
                f"the function made {type(env).__name__}, which lacks {', '.join(missing)}; it must make a "
                "gymnasium.Env"
            )
        return env


def _declared(space: gymnasium.Space[Any]) -> Any:
    if isinstance(space, gymnasium.spaces.Box):
        bounds = [np.asarray(bound, dtype=np.float64) for bound in (space.low, space.high)]
        # Images have the same bounds for thousands of pixels.
        low, high = (bound.reshape(-1)[: 1 if _alike(bound) else None].tolist() for bound in bounds)
        if len(low) != len(high):
            low, high = (bound.reshape(-1).tolist() for bound in bounds)
        return str(space.dtype), list(space.shape), low, high
    return str(space)


def _alike(bound: np.ndarray) -> bool:
    return bound.size > 0 and bool(np.all(bound == bound.flat[0]))


def _name(env: AnyEnv) -> str:
    spec = getattr(env, "spec", None)
    name = spec.id if spec is not None else type(getattr(env, "unwrapped", env)).__name__
    return re.sub(r"[^\w.-]+", "-", name).lstrip(".") or "task"


def _time_limit(env: AnyEnv) -> Optional[int]:
    """The smallest time limit that the environment and its wrappers state."""
    limits = []
    spec = getattr(env, "spec", None)
    if spec is not None and spec.max_episode_steps is not None:
        limits.append(spec.max_episode_steps)
    inner: Any = env
    while inner is not None:
        if isinstance(inner, gymnasium.wrappers.TimeLimit):
            limits.append(inner._max_episode_steps)
        limits.append(getattr(inner, "steps_per_episode", None) if inner is getattr(inner, "unwrapped", inner) else None)
        inner = getattr(inner, "env", None) if isinstance(inner, gymnasium.Wrapper) else None
    known = [int(limit) for limit in limits if limit is not None]
    return min(known) if known else None
