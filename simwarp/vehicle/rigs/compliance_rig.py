"""Compliance of an axle: what side, brake and drive forces on its wheels do to their angles, by bushings and springs.

Wheels are held at their height in the standing vehicle; each force is a world, brought to rest by statics. A linkage
without bushings is rigid: its angles stay.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.analysis import solve_static
from simwarp.core.object_repr import Readable, Row, plural
from simwarp.core.types import JointType, ModelError
from simwarp.vehicle.rigs.rig_rows import Reasons, RigRows, RowStatus, Statuses
from simwarp.vehicle.rigs.suspension_curves import SuspensionReference
from simwarp.vehicle.rigs.suspension_rig import reference_state
from simwarp.vehicle.spec.parts import Array, SpecError
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.suspensions.kinematics import HeldAxle, hold_axle, wheel_angles
from simwarp.vehicle.suspensions.wheel_axes import contact_points


class WheelForce(enum.Enum):
    """A force on both wheels of an axle."""

    SIDE = "side"
    """To the left, at the contact points."""
    BRAKE = "brake"
    """Backwards, at the contact points of wheels whose brakes are locked."""
    DRIVE = "drive"
    """Forwards, at the centres of wheels that turn freely."""


@dataclasses.dataclass(frozen=True, repr=False)
class ComplianceCurve(Readable):
    """Angles of an axle's wheels over a force; n states, columns left and right. NaN where a state is not DONE.

    Attributes:
        kind: of the force.
        force: (n,) on each wheel [N].
        steer: (n, 2) heading of the wheels, positive to the left [rad].
        toe: (n, 2) positive inwards [rad].
        camber: (n, 2) positive where the top leans outwards [rad].
        shift: (n, 2, 2) of the wheels' centres forwards and to the left, from those of no force [m].
        status: (n,) `RowStatus`.
        reason: (n,) texts: why a state is not DONE; empty of the others.
    """

    kind: WheelForce
    force: Array
    steer: Array
    toe: Array
    camber: Array
    shift: Array
    status: Statuses
    reason: Reasons

    def _readable_title(self) -> str:
        return f": {self.kind.value} force, {plural(len(self.force), 'state')}"

    def _readable_rows(self) -> Mapping[str, Row]:
        return {name: f"{value:.4g}" for name, value in self.parameters().items()}

    def rows(self) -> RigRows:
        """States as rows; angles in degrees."""
        columns: dict[str, npt.NDArray[Any]] = {
            "force": np.full(len(self.force), self.kind.value), "force_N": self.force,
        }  # fmt: skip
        for column, side in enumerate("LR"):
            columns |= {
                f"steer_{side}_deg": np.rad2deg(self.steer[:, column]),
                f"toe_{side}_deg": np.rad2deg(self.toe[:, column]),
                f"camber_{side}_deg": np.rad2deg(self.camber[:, column]),
                f"shift_x_{side}_mm": 1e3 * self.shift[:, column, 0],
                f"shift_y_{side}_mm": 1e3 * self.shift[:, column, 1],
            }
        return RigRows(columns, self.status, self.reason, ("force", "force_N"))

    def parameters(self) -> dict[str, float]:
        """Slopes of the left wheel's angles and shifts over the force; keys name units, such as [mm/kN]."""
        kind = self.kind.value
        return {
            f"{kind}_steer_deg_per_kN": 1e3 * math.degrees(self._slope(self.steer[:, 0])),
            f"{kind}_camber_deg_per_kN": 1e3 * math.degrees(self._slope(self.camber[:, 0])),
            f"{kind}_shift_x_mm_per_kN": 1e6 * self._slope(self.shift[:, 0, 0]),
            f"{kind}_shift_y_mm_per_kN": 1e6 * self._slope(self.shift[:, 0, 1]),
        }

    def _slope(self, values: Array) -> float:
        done = self.status == RowStatus.DONE
        if done.sum() < 2:
            return math.nan
        away = self.force[done] - self.force[done].mean()
        return float(away @ values[done] / (away @ away))


def run_compliance_rig(
    spec: VehicleSpec, axle: int = 0, kind: WheelForce = WheelForce.SIDE, *, force: float = 2000.0, points: int = 5,
    reference: SuspensionReference = SuspensionReference.STANDING, device: str = "cpu",
) -> ComplianceCurve:  # fmt: skip
    """Angles of an axle's wheels under a force on each of them, all forces in one batch.

    Args:
        spec: the vehicle.
        axle: index, from the front.
        kind: of the force.
        force: largest, in both directions [N].
        points: of the sweep, an odd number: the middle one is that of no force.
        reference: state in which wheels are held.
        device: that runs the worlds.

    Raises:
        SpecError: no such axle, or one without springs; an empty range.
    """
    if not (math.isfinite(force) and force > 0.0):
        raise SpecError(f"force: must be > 0 N, got {force:g}: the range would be empty")
    if points < 3 or points % 2 == 0:
        raise SpecError(f"points: must be an odd number from 3 on, got {points}: the middle one has no force")
    state = reference_state(spec, axle, reference, device=device)
    forces = np.linspace(-force, force, points)
    held = hold_axle(spec, axle, np.full(points, state.travel), state.travel, device=device)
    reached, reason = held.reached.copy(), held.reason.copy()
    # without bushings nothing that can move is left: the closed linkage is the equilibrium under any force
    if any(joint.type is JointType.BUSHING for joint in held.simulation.model.builder.joints):
        _push(held, kind, forces, state.loaded_radius)
        try:
            solve_static(held.simulation)
        except ModelError as error:
            reason[reached] = f"it does not come to rest: {error}"
            reached[:] = False
    table = wheel_angles(held)
    shift = (table.center - table.center[points // 2])[..., :2]
    status = np.where(reached, RowStatus.DONE, RowStatus.DIVERGED).astype(np.int8)
    for values in (table.steer, table.toe, table.camber, shift):
        values[status != RowStatus.DONE] = np.nan
    return ComplianceCurve(kind, forces, table.steer, table.toe, table.camber, shift, status, reason)


def _push(held: HeldAxle, kind: WheelForce, forces: Array, radius: float) -> None:
    """Put (n,) forces on the bodies that the wheels turn in."""
    control, state = held.simulation.control, held.simulation.state
    table = wheel_angles(held)
    x = np.asarray(state.body_x.numpy(), np.float64)
    force, torque = (np.asarray(array.numpy(), np.float64) for array in (control.body_force, control.body_torque))
    direction = {
        WheelForce.SIDE: (0.0, 1.0, 0.0),
        WheelForce.BRAKE: (-1.0, 0.0, 0.0),
        WheelForce.DRIVE: (1.0, 0.0, 0.0),
    }
    for column, side in enumerate(held.bench.sides):
        applied = forces[:, None] * np.array(direction[kind])
        point = table.center[:, column]
        if kind is not WheelForce.DRIVE:
            point = contact_points(point, table.axis[:, column], radius)
        force[:, side.carrier] += applied
        torque[:, side.carrier] += np.cross(point - x[:, side.carrier], applied)
    control.body_force.assign(force.astype(np.float32))
    control.body_torque.assign(torque.astype(np.float32))
