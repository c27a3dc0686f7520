"""Defaults of training by camera that driving tasks share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

BY_CAMERA: Mapping[str, Any] = {
    "network.kind": "early-fusion",
    "network.critic": "privileged",
    "network.hidden": (128, 64),
    "network.init_mean": (0.0,),
}
"""Training by camera: the critic, which only training needs, sees the exact state."""
PEDALS_BY_CAMERA: Mapping[str, Any] = {**BY_CAMERA, "network.init_mean": (0.0, 0.3)}
"""The same where pedals are worked, with some throttle to begin with: who stands still sees nothing to learn from."""
PEDALS_BY_LIDAR: Mapping[str, Any] = {**PEDALS_BY_CAMERA, "network.kind": "multi-input"}
"""The same with a range image in place of the camera's."""
BY_IMAGES_ALONE: Mapping[str, Any] = {
    "network.kind": "nature-cnn",
    "network.critic": "same",
    "network.init_std": 0.6,
    "network.tanh_output": True,
    "ppo.entropy": 0.001,
}
"""Training as the thesis has it where the image is all that is seen: two networks alike, a mean bound to [-1, 1]."""
