"""Arguments that several functions share, as the extension module reads them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Optional, Union

from .errors import ConfigError

Config = Mapping[str, Any]
Presets = Union[str, Sequence[str]]


def arguments(
    *,
    task: Optional[str] = None,
    method: Optional[str] = None,
    ablation: Optional[str] = None,
    distractor: Optional[str] = None,
    seed: Optional[int] = None,
    environment_steps: Optional[int] = None,
    device: Optional[str] = None,
    threads: Optional[int] = None,
    preset: Presets = (),
    config: Optional[Config] = None,
) -> dict[str, Any]:
    """The dictionary that the extension module's functions expect."""
    return {
        "task": task,
        "method": method,
        "ablation": ablation,
        "distractor": distractor,
        "seed": _whole("seed", seed),
        "environment_steps": _whole("environment_steps", environment_steps),
        "device": device,
        "threads": _whole("threads", threads),
        "presets": [preset] if isinstance(preset, str) else list(preset),
        "config": _flat(config or {}),
    }


def _whole(name: str, value: Any) -> Optional[int]:
    """A whole number, also written as a float: 1e5."""
    if value is None:
        return None
    try:
        whole = int(value)
    except (TypeError, ValueError, OverflowError):
        whole = None
    if isinstance(value, (bool, str)) or whole is None or whole != value:
        raise ConfigError(f"{name} = {value!r} is not a whole number; expected one, such as 100_000")
    return whole


def _flat(config: Config, prefix: str = "") -> dict[str, Any]:
    """Settings by dotted key; sections may be dictionaries."""
    if not isinstance(config, Mapping):
        raise ConfigError(
            f"config = {config!r} is not a dictionary; expected settings by dotted key, such as "
            '{"sac.batch_size": 64}'
        )
    flat: dict[str, Any] = {}
    for key, value in config.items():
        if isinstance(value, Mapping):
            flat.update(_flat(value, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = value
    return flat
