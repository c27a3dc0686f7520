"""Which joint keeps a mechanism from closing, in words."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.model.model import Model
from simwarp.simulation.joint_errors import SOUND_ANGLE, SOUND_GAP, joint_errors
from simwarp.simulation.state import State


def open_joints(model: Model, state: State, worlds: npt.NDArray[np.integer[Any]]) -> list[str]:
    """A phrase for each of these worlds: the joint whose sides are farthest apart, and how far.

    Args:
        model: of the worlds.
        state: their poses.
        worlds: (n,) indices.
    """
    errors = joint_errors(model, state, worlds)
    found = []
    for travel, angle in zip(errors.travel, errors.angle, strict=True):
        shares = np.nan_to_num(np.stack([travel / SOUND_GAP, angle / SOUND_ANGLE]), nan=np.inf)
        turned, joint = np.unravel_index(int(shares.argmax()), shares.shape)
        gap = f"{angle[joint]:.2g} rad" if turned else f"{1e3 * travel[joint]:.3g} mm"
        found.append(f"joint '{model.joint_names[joint]}' stays {gap} apart")
    return found
