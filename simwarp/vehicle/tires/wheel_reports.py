"""Outputs of tires whose forces are made elsewhere: by contact, or by soil."""

from __future__ import annotations

import copy
from typing import Any, Final, Self

import warp as wp

from simwarp.core.arrays import WritableArray, writable
from simwarp.core.object_repr import Readable, plural
from simwarp.core.schema import Fault, fault_text
from simwarp.model.model import Model

REPORTED: Final = ("load", "slip_ratio", "slip_angle", "camber", "deflection", "force_w", "torque_w")
"""What is reported of every wheel."""


def parameter_text(fault: Fault) -> str:
    """A fault of a tire's parameters in one line."""
    return f"parameters.{fault_text(fault)}"


class WheelReports(Readable):
    """The outputs of `Tires`, zero until somebody writes them.

    Args:
        count: of the wheels.
        model: of the vehicle.

    Attributes:
        shape: worlds and wheels.
        load: (W, wheels) vertical force [N].
        slip_ratio, slip_angle, camber: (W, wheels) [1, rad, rad].
        deflection: (W, wheels) [m].
        force_w, torque_w: (W, wheels) vec3 on each wheel at its centre, world axes [N, N·m].
        state: (W, wheels, 1).
    """

    load: wp.array
    slip_ratio: wp.array
    slip_angle: wp.array
    camber: wp.array
    deflection: wp.array
    ground_friction: WritableArray

    def __init__(self, count: int, model: Model) -> None:
        self.shape = (model.world_count, count)
        for name in ("load", "slip_ratio", "slip_angle", "camber", "deflection"):
            setattr(self, name, writable(self.shape, wp.float32, model.device))
        self.force_w = writable(self.shape, wp.vec3, model.device)
        self.torque_w = writable(self.shape, wp.vec3, model.device)
        self.state = writable((*self.shape, 1), wp.float32, model.device)

    @property
    def world_parameters(self) -> dict[str, wp.array]:
        """What may differ by world: the road's friction."""
        return {"ground_friction": self.ground_friction}

    def show_soil(self, soil: Any, first: int) -> None:
        """From now on report what a soil finds of its shapes from number `first` on."""
        wheels = slice(first, first + self.shape[1])
        for name, of_soil in (("load", "load"), ("slip_ratio", "slip_ratio"), ("deflection", "sinkage")):
            setattr(self, name, getattr(soil, of_soil)[:, wheels])
        self.force_w, self.torque_w = soil.force_w[:, wheels], soil.torque_w[:, wheels]

    def of(self, first: int, count: int) -> Self:
        """`count` wheels of these from number `first` on: views of the same memory."""
        part, wheels = copy.copy(self), slice(first, first + count)
        part.shape = (self.shape[0], count)
        for name in (*REPORTED, "state"):
            setattr(part, name, getattr(self, name)[:, wheels])
        return part

    def _readable_title(self) -> str:
        return f": {self.shape[1]} in each of {plural(self.shape[0], 'world')}"
