"""Exceptions of hksl. Their messages are those of the command line.

All derive from `Error`, and from the built-in exception that describes them:

- `ConfigError` (`ValueError`): a task, setting or space that cannot be used; nothing has been written.
- `ArrayError` (`ValueError`): an array of another shape or type than documented.
- `TaskError` (`RuntimeError`): an environment that returned what it must not, or was used out of order.
- `RunError` (`RuntimeError`): a run's folder that is missing, in use or damaged, or too little memory.
- `NotFiniteError` (`ArithmeticError`): NaN or infinity in an action, a reward, a loss or a weight.
- `BusyError` (`RuntimeError`): an object that another thread is using.
- `NativeError` (`OSError`): MuJoCo, its models or the graphics libraries are missing.

Exceptions of your own environment are raised as they are.
"""

__all__ = [
    "ArrayError",
    "BusyError",
    "ConfigError",
    "Error",
    "NativeError",
    "NotFiniteError",
    "RunError",
    "TaskError",
]


class Error(Exception):
    """Base of all exceptions of hksl."""


class ConfigError(Error, ValueError):
    """A task, setting or space that cannot be used."""


class ArrayError(Error, ValueError):
    """An array of another shape or type than documented."""


class TaskError(Error, RuntimeError):
    """An environment that returned what it must not, or was used out of order."""


class RunError(Error, RuntimeError):
    """A run's folder that is missing, in use or damaged, or too little memory."""


class NotFiniteError(Error, ArithmeticError):
    """NaN or infinity in an action, a reward, a loss or a weight."""


class BusyError(Error, RuntimeError):
    """An object that another thread is using."""


class NativeError(Error, OSError):
    """MuJoCo, its models or the graphics libraries are missing."""
