"""Friction that comes up with the speed of slip, for comparisons with recorded runs of penalty contacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from simwarp.core.types import ModelError
from simwarp.model.model import Model
from simwarp.simulation.attachments import ForceElement, StepContext
from simwarp.verify.slip_friction_kernels import set_slip_friction


class SlipFriction(ForceElement):
    """Coefficients of friction mu tanh(slip / speed) of some shapes: below that speed their contacts hold nothing.

    It reads the slip at the start of a step and writes `shape_friction` for it. The law of dry friction is the limit of
    small speeds. Balls suit it, which touch one other shape at a time.

    Args:
        model: made with `shape_friction` among `per_world`.
        shapes: indices of those with the rule.
        speed: of the slip at which three quarters of the coefficient act [m/s].
    """

    def __init__(self, model: Model, shapes: Sequence[int], speed: float) -> None:
        if model.shape_friction.shape[0] != model.world_count:
            raise ModelError(
                "SlipFriction: every world needs its own shape_friction; name it in finalize(per_world=...)"
            )
        own = np.full(len(model.builder.shapes), -1.0, np.float32)
        own[list(shapes)] = model.shape_friction.numpy()[0, list(shapes)]
        self.model, self.speed = model, speed
        self._own: wp.array = wp.array(own, dtype=float, device=model.device)

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch that writes the coefficients."""
        model = simulation.model
        return [
            simulation.shares.record(
                set_slip_friction,
                inputs=[self.speed, self._own, model.topology, simulation.state.arrays, simulation.contacts.arrays],
                outputs=[model.parameters],
            )
        ]  # fmt: skip
