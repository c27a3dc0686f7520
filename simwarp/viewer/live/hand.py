"""A hand: the force element by which a person pulls at one body of one world."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.types import WORLD, ModelError, formatted
from simwarp.model.model import Model
from simwarp.simulation.attachments import ForceElement, StepContext
from simwarp.viewer.live.hand_kernels import Grip, let_go, pull

Array = npt.NDArray[np.float64]

STIFFNESS: Final = 50.0
"""Of the spring [m/s² per metre], times the mass of all that hangs together with the body."""
MOST: Final = 5.0
"""Largest force over the weight of all that hangs together."""
GRAVITY: Final = 9.81
"""That weighs where a world has none [m/s²]."""
STABLE: Final = 0.5
"""Share of the momentum of the grabbed point that the damper may take in one sub-step: a light part of a heavy robot
would be thrown about by a damper that suits the whole."""


@dataclasses.dataclass(frozen=True, eq=False)
class Hold:
    """What is held: a body of a world, and the point of it in body axes from the centre of mass [m]."""

    world: int
    body: int
    grab: Array


class Hand(ForceElement):
    """Pulls at one body of one world: F = k (pointer - grab) - c v, a `ForceElement`.

    k is 50 m/s² per metre and kilogram of all that joints connect with the body, c damps that critically, and the force
    is at most 5 times the weight of it. It comes after all other elements, adds to what they wrote, and takes it away
    again after the sub-step. Without a hold it changes no bit.

    Args:
        model: whose bodies it may hold.

    Attributes:
        hold: what is held; None: nothing.
        pointer: (3,) where it is pulled to [m].
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.hold: Hold | None = None
        self.pointer = np.zeros(3)
        self._groups = connected(model)
        self._dt = 0.0
        device = model.device
        self._grip: Any = Grip()
        self._grip.world = wp.array([-1], dtype=int, device=device)
        self._grip.body = wp.zeros(1, dtype=int, device=device)
        for name, dtype in (("grab", wp.vec3d), ("pointer", wp.vec3d), ("law", wp.vec3), ("force", wp.vec3)):
            setattr(self._grip, name, wp.zeros(1, dtype=dtype, device=device))
        self._grip.torque = wp.zeros(1, dtype=wp.vec3, device=device)

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch before a sub-step of `dt` [s]."""
        if simulation.elements[-1] is not self:
            raise ModelError("Hand: it must be the last of the elements, since it adds to what they write; append it")
        self._dt = dt
        state, control = simulation.state.arrays, simulation.control.arrays
        return [simulation.shares.record(pull, inputs=[self._grip, state], outputs=[control])]

    def record_after(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch after a sub-step."""
        return [simulation.shares.record(let_go, inputs=[self._grip], outputs=[simulation.control.arrays])]

    def grab(self, world: int, body: int, grab: npt.ArrayLike, pointer: npt.ArrayLike) -> None:
        """Takes hold, to be called between steps.

        Args:
            world, body: indices.
            grab: (3,) point of the body, body axes from the centre of mass [m].
            pointer: (3,) where it is pulled to, world axes [m].

        Raises:
            ModelError: there is no such world or body.
        """
        model = self.model
        if not 0 <= world < model.world_count or not 0 <= body < model.body_count:
            raise ModelError(
                f"Hand: world and body must be below {model.world_count} and {model.body_count}, got "
                f"{formatted(world)} and {formatted(body)}; name a body of the model"
            )
        self.hold = Hold(int(world), int(body), np.asarray(grab, np.float64).reshape(3))
        law = self._law(self.hold)
        self._grip.body.assign(np.array([body], np.int32))
        self._grip.grab.assign(self.hold.grab[None])
        self._grip.law.assign(np.array([law], np.float32))
        self.move(pointer)
        self._grip.world.assign(np.array([world], np.int32))

    def move(self, pointer: npt.ArrayLike) -> None:
        """Pulls to another place, world axes [m]."""
        place = np.asarray(pointer, np.float64).reshape(3)
        if np.isfinite(place).all():
            self.pointer = place
            self._grip.pointer.assign(place[None])

    def release(self) -> None:
        """Holds nothing."""
        self.hold = None
        self._grip.world.assign(np.array([-1], np.int32))

    def grabbed(self, x: Array, rotation: Array) -> Array:
        """(3,) the held point, of a body at x [m] with a rotation xyzw."""
        if self.hold is None:
            return x
        axis, real = rotation[:3], rotation[3]
        across = 2.0 * np.cross(axis, self.hold.grab)
        return np.asarray(x + self.hold.grab + real * across + np.cross(axis, across))

    def _law(self, hold: Hold) -> tuple[float, float, float]:
        """Stiffness [N/m], damping [N s/m], largest force [N]."""
        masses = _row(self.model.body_mass, hold.world).astype(np.float64)
        mass = float(masses[self._groups == self._groups[hold.body]].sum())
        stiffness, damping = STIFFNESS * mass, 2.0 * math.sqrt(STIFFNESS) * mass
        own = float(masses[hold.body])
        if own > 0.0 and self._dt > 0.0:
            inertia = _row(self.model.body_inertia_b, hold.world)[hold.body].astype(np.float64)
            least = max(float(np.linalg.eigvalsh(inertia)[0]), 1e-12)
            point = 1.0 / (1.0 / own + float(hold.grab @ hold.grab) / least)
            damping = min(damping, STABLE * point / self._dt)
            stiffness = min(stiffness, 0.25 * STABLE * point / self._dt**2)
        gravity = float(np.linalg.norm(_row(self.model.gravity, hold.world)))
        return stiffness, damping, MOST * mass * (gravity or GRAVITY)


def with_hand(model: Model) -> Sequence[Hand]:
    """The elements that a page adds to a simulation."""
    return (Hand(model),) if model.body_count else ()


def hand_of(elements: Sequence[Any]) -> Hand | None:
    """The hand among the elements of a simulation."""
    return next((element for element in elements if isinstance(element, Hand)), None)


def connected(model: Model) -> npt.NDArray[np.int64]:
    """(B,) a number for each body, the same for those that joints connect otherwise than through the world."""
    group = np.arange(model.body_count)
    for joint in model.builder.joints:
        if WORLD not in (joint.parent, joint.child):
            group[group == group[joint.child]] = group[joint.parent]
    return group


def _row(array: Any, world: int) -> Any:
    values = array.numpy()
    return values[world if len(values) > 1 else 0]
