"""Numbers of one world by name: where a body is, how far a joint has moved, what time it is."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.arrays import on_host
from simwarp.model.checks import checked_index, whole_number
from simwarp.model.model import Model
from simwarp.simulation.state import State

Vector: TypeAlias = npt.NDArray[np.floating[Any]]


class Readings:
    """Numbers of one world for Python and NumPy: to print, to plot, to test.

    Each call copies what it returns, and waits for a GPU. All worlds at once are in the arrays of `state`.

    Attributes:
        model: with the names.
        state: that is read.
    """

    model: Model
    state: State

    def world_time(self, world: int = 0) -> float:
        """Time of a world since its last reset [s].

        Raises:
            ModelError: there is no such world.
        """
        return float(self._of("world_time", self.state.world_time, world))

    def body_position(self, body: str | int, world: int = 0) -> Vector:
        """(3,) float64 position of a body's centre of mass [m], world frame.

        Args:
            body: its name or index.
            world: index of the world.

        Raises:
            ModelError: there is no such body or world.
        """
        return self._of_body("body_position", self.state.body_x, body, world)

    def body_rotation(self, body: str | int, world: int = 0) -> Vector:
        """(4,) float64 quaternion xyzw from a body's axes to those of the world; arguments as `body_position`."""
        return self._of_body("body_rotation", self.state.body_rot, body, world)

    def body_velocity(self, body: str | int, world: int = 0) -> Vector:
        """(3,) float32 velocity of a body's centre of mass [m/s], world axes; arguments as `body_position`."""
        return self._of_body("body_velocity", self.state.body_v, body, world)

    def body_angular_velocity(self, body: str | int, world: int = 0) -> Vector:
        """(3,) float32 angular velocity of a body [rad/s], world axes; arguments as `body_position`."""
        return self._of_body("body_angular_velocity", self.state.body_omega, body, world)

    def joint_position(self, joint: str | int, world: int = 0, *, local: int = 0) -> float:
        """Coordinate of a joint: angle, turns counted [rad], or travel [m].

        Args:
            joint: its name or index.
            world: index of the world.
            local: which of the joint's coordinates, from 0.

        Raises:
            ModelError: there is no such joint, coordinate or world.
        """
        return self._of_joint("joint_position", self.state.joint_x, joint, world, local)

    def joint_velocity(self, joint: str | int, world: int = 0, *, local: int = 0) -> float:
        """Rate of a joint's coordinate [rad/s or m/s]; arguments as `joint_position`."""
        return self._of_joint("joint_velocity", self.state.joint_qd, joint, world, local)

    def _of_body(self, call: str, array: wp.array, body: str | int, world: int) -> Vector:
        names = self.model.body_names
        rule = f"body must be a name or an index below {len(names)}"
        index = checked_index(call, rule, body, len(names), self.model.body, "see model.body_names")
        return self._of(call, array, world, index)

    def _of_joint(self, call: str, array: wp.array, joint: str | int, world: int, local: int) -> float:
        names = self.model.joint_names
        rule = f"joint must be a name or an index below {len(names)}"
        name = names[checked_index(call, rule, joint, len(names), self.model.joint, "see model.joint_names")]
        return float(self._of(call, array, world, self.model.dof(name, local)))

    def _of(self, call: str, array: wp.array, world: int, column: int | None = None) -> Vector:
        """One element, which alone is copied from the device."""
        worlds = self.model.world_count
        row = whole_number(call, "world", world, 0, worlds - 1, f"there are {worlds} worlds")
        part: Any = array if column is None else array[row]
        first = row if column is None else column
        value: Vector = part[first : first + 1].numpy()[0]
        return value.copy()  # of a CPU it is the memory that the next step writes


def span_text(array: wp.array, unit: str) -> str:
    """The least and the greatest value of an array; nothing of an array on a GPU, for which it would have to wait."""
    if not on_host(array):
        return ""
    values = array.numpy()
    least, most = values.min(), values.max()
    return f"{least:.6g} {unit}" if least == most else f"{least:.6g} to {most:.6g} {unit}"
