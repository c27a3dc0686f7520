"""Lidars by name."""

from __future__ import annotations

from typing import Any

from simwarp.sensors.lidar import LidarConfig
from simwarp.sensors.presets import load_config
from simwarp.types import ModelError


def lidar_preset(name: str, **changes: Any) -> LidarConfig:
    """`load_config` for lidars alone.

    Raises:
        ModelError: no lidar has this name, or a change breaks a rule.
    """
    config = load_config(name, **changes)
    if not isinstance(config, LidarConfig):
        raise ModelError(f"lidar_preset: '{name}' is no lidar; take it from load_config")
    return config
