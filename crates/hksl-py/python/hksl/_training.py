"""Training and probing."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Optional, Union

from . import _native
from ._arguments import Config, Presets, arguments
from ._bridge import Brought, EnvironmentFactory
from ._progress import Progress
from .errors import ConfigError

PathLike = Union[str, "os.PathLike[str]"]
Watch = Callable[[str, dict[str, Any]], None]


@dataclass(frozen=True)
class Training:
    """How `hksl.train` ended."""

    #: The run's folder.
    folder: Path
    #: `done`, or `done before` if the budget had been used up already.
    ending: Literal["done", "done before", "stopped"]
    #: Mean return of the last evaluation; NaN if there was none.
    final_return: float
    #: Mean return and environment step of the best evaluation.
    best_evaluation: Optional[tuple[float, int]]
    #: Environment steps taken: agent steps times action repeat.
    environment_step: int
    #: Agent steps taken.
    agent_step: int
    #: Seconds that the run took, without pauses.
    wall_seconds: float


def train(
    environment: Union[str, EnvironmentFactory],
    *,
    method: Optional[str] = None,
    runs: PathLike = "runs",
    environment_steps: Optional[int] = None,
    seed: Optional[int] = None,
    name: Optional[str] = None,
    preset: Presets = (),
    config: Optional[Config] = None,
    ablation: Optional[str] = None,
    distractor: Optional[str] = None,
    device: Optional[str] = None,
    threads: Optional[int] = None,
    resume: Literal["auto", "never"] = "auto",
    task: Optional[str] = None,
    progress: Union[bool, Watch] = True,
) -> Training:
    """Trains an agent, or resumes a run that was stopped.

    The run is the one that `hksl train` would make: the same folder, metrics, TensorBoard events and checkpoints and,
    for a task of hksl, the same numbers bit for bit.

    Parameters
    ----------
    environment
        The name of a task of hksl, or a function that makes a Gymnasium environment: one for training, one for each
        evaluation. Its observations are images, a `Box` of `uint8` with 1 or 3 channels; its actions a `Box` of floats
        with finite bounds, to which hksl scales its actions from [-1, 1]. Frames are used as they are: hksl never
        resizes them, and stacks `environment.frame_stack` of them.
    method
        `hksl` by default; `hksl.methods()` lists all.
    runs
        Folder for all runs.
    environment_steps
        Budget, in steps of the environment. A larger one extends a finished run.
    seed
        Seed of all random numbers, 1 by default. Each episode of your environment is reset with a seed drawn from it.
    name
        Variant name in the run's folder, instead of the presets' names.
    preset
        One or several presets, such as `debug`, `small` or `crop`.
    config
        Settings by dotted key, such as `{"sac.batch_size": 64}`, or by section, `{"sac": {"batch_size": 64}}`;
        `hksl config show` prints all. `environment.action_repeat` is 1 for your environments.
    ablation, distractor, device, threads
        As for `hksl train`. The number of threads can be set once in a process.
    resume
        `auto` resumes an existing run, `never` raises `ConfigError` and does not touch it.
    task
        Name of your environment in the run's folder; by default that of its spec or class.
    progress
        False for silence, or a function that receives the name of each event and its figures.

    Ctrl-C, or an exception of your environment, saves the run and is raised as it is. The same call resumes the run. An
    environment of Gymnasium cannot be restored in the middle of an episode, so it then begins a new episode.
    """
    if resume not in ("auto", "never"):
        raise ConfigError(f"resume = {resume!r} is not valid; expected 'auto' or 'never'")
    own = None if isinstance(environment, str) else Brought(environment, task, ())
    if own is None and task is not None:
        raise ConfigError(f"task = {task!r} names environments of your own; leave it out for a task of hksl")
    try:
        given = arguments(
            task=environment if isinstance(environment, str) else None,
            method=method,
            ablation=ablation,
            distractor=distractor,
            seed=seed,
            environment_steps=environment_steps,
            device=device,
            threads=threads,
            preset=preset,
            config=config,
        )
        place = {
            "runs": Path(runs),
            "name": name,
            "resume": resume == "auto",
            "command": _command(given, own, runs, name, resume),
        }
        shown = Progress() if progress is True else None
        watch = shown or (progress if callable(progress) else _ignore)
        try:
            ended = _native.train(given, place, own, watch)
        finally:
            if shown is not None:
                shown.close()
    finally:
        if own is not None:
            own.close()
    return Training(**{**ended, "folder": Path(ended["folder"])})


def probe(
    run: PathLike,
    environment: EnvironmentFactory,
    info: Sequence[str],
    *,
    checkpoint: Optional[int] = None,
    horizons: Optional[Sequence[int]] = None,
    train_episodes: int = 10,
    test_episodes: int = 5,
    policy: Literal["random", "run"] = "random",
    seed: int = 1,
    device: str = "auto",
) -> list[dict[str, Any]]:
    """Predicts quantities of `info` from a run's frozen encoders with linear maps, as `hksl probe` does for its tasks.

    Parameters
    ----------
    run
        Folder of a run that was trained in your environment.
    environment
        A function that makes this environment.
    info
        Keys of the `info` that `reset` and `step` return, with numbers or arrays of fixed size.
    checkpoint
        Environment step of the checkpoint, by default the newest.
    horizons
        Agent steps that the maps predict ahead; 1, 5 and 10 by default.
    train_episodes, test_episodes
        Episodes to fit the maps on, and to test them on.
    policy
        What plays the episodes: random actions, or the run's own policy.

    Returns one dictionary for each encoder and horizon: `encoder`, `horizon`, `mse` over the test episodes, its standard
    deviation over them `mse_std`, `mse_by_coordinate`, and `constant_mse`, the error of always predicting the mean.
    """
    if policy not in ("random", "run"):
        raise ConfigError(f"policy = {policy!r} is not valid; expected 'random' or 'run'")
    keys = [info] if isinstance(info, str) else list(info)
    if not keys:
        raise ConfigError("info names no keys; name those to predict, such as [\"position\"]")
    own = Brought(environment, None, keys)
    settings = {
        "checkpoint": checkpoint,
        "info": keys,
        "horizons": None if horizons is None else [int(horizon) for horizon in horizons],
        "train_episodes": train_episodes,
        "test_episodes": test_episodes,
        "seed": seed,
        "on_policy": policy == "run",
        "device": device,
    }
    try:
        return _native.probe(Path(run), settings, own)
    finally:
        own.close()


def _ignore(event: str, figures: dict[str, Any]) -> None:
    """Shows nothing."""


def _command(
    given: dict[str, Any], own: Optional[Brought], runs: PathLike, name: Optional[str], resume: str
) -> str:
    """The call, for the run's `command.txt`."""
    first = repr(given["task"]) if own is None else own.task
    names = ("method", "ablation", "distractor", "seed", "environment_steps", "device", "threads")
    parts = [f"{key}={given[key]!r}" for key in names if given[key] is not None]
    parts += [f"preset={given['presets']!r}"] if given["presets"] else []
    parts += [f"config={given['config']!r}"] if given["config"] else []
    parts += [f"runs={os.fspath(runs)!r}"]
    parts += [f"name={name!r}"] if name is not None else []
    parts += [f"resume={resume!r}"] if resume != "auto" else []
    return f"hksl.train({', '.join([first, *parts])})".replace("\n", " ")
