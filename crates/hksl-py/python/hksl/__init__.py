"""HKSL: reinforcement learning from pixels with hierarchical forward models.

- Tasks: `gymnasium.make("hksl/cartpole-swingup-v0")`, for each name in `hksl.tasks()`.
- Training: `hksl.train(environment)`, in one of these or in any Gymnasium environment that shows images.
- Policies: `hksl.load(run)` acts, encodes and exports.
- Probes: `hksl.probe(run, environment, info)` tells what encoders know of `info`.
- `hksl.Agent`, for a training loop of your own.

Frames and observations are `uint8` arrays, actions `float32`. hksl uses all cores, without Python's global lock. Errors
are described in `hksl.errors`. The package also installs the command `hksl`.
"""

import os as _os
from pathlib import Path as _Path

# Candle's own threads would wait busily on the cores that hksl's use; it reads this once, when it computes first.
_os.environ.setdefault("CANDLE_NUM_THREADS", "1")

from . import _native

_models = _Path(__file__).parent / "native" / "models"
if _models.is_dir():
    _native.set_models(_models)

from ._agent import Agent
from ._policy import Policy, load
from ._training import Training, probe, train
from .envs import HkslEnv, register, tasks
from .errors import (
    ArrayError,
    BusyError,
    ConfigError,
    Error,
    NativeError,
    NotFiniteError,
    RunError,
    TaskError,
)

__version__ = _native.__version__


def methods() -> list[str]:
    """The names of the learning methods, the default first."""
    return _native.methods()


register()

__all__ = [
    "Agent",
    "ArrayError",
    "BusyError",
    "ConfigError",
    "Error",
    "HkslEnv",
    "NativeError",
    "NotFiniteError",
    "Policy",
    "RunError",
    "TaskError",
    "Training",
    "load",
    "methods",
    "probe",
    "register",
    "tasks",
    "train",
]
