"""A steering from lock to lock: angles of the road wheels, ratio, Ackermann's percentage, turning circle.

Nothing but the linkage plays a part: wheels stand at their height as built and roll without slip.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import Readable, Row, plural
from simwarp.vehicle.rigs.rig_rows import Reasons, RigRows, RowStatus, Statuses, slopes
from simwarp.vehicle.rigs.suspension_rig import checked_axle
from simwarp.vehicle.spec.parts import Array, SpecError
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.suspensions.kinematics import TravelTable, travel_table
from simwarp.vehicle.suspensions.wheel_axes import contact_points


@dataclasses.dataclass(frozen=True, repr=False)
class SteeringCurve(Readable):
    """A steered axle from lock to lock; n states, columns left and right. NaN where a state is not DONE.

    Attributes:
        axle: its index, from the front.
        steering: (n,) ratio of the steering's travel, -1 to 1, positive to the left.
        handwheel: (n,) angle of the handwheel, positive to the left [rad].
        steer: (n, 2) heading of the wheels, positive to the left [rad].
        ratio: (n,) of the handwheel's angle to the mean angle of the wheels, by their changes.
        toe: (n, 2) of the wheels, positive inwards [rad].
        camber: (n, 2) of the wheels, positive where the top leans outwards [rad].
        ackermann_difference: (n,) by which the inner wheel should turn further than the outer one [rad].
        ackermann: (n,) ratio of the difference of both angles to that; NaN straight on.
        turn_radius: (n,) from the turning point to the middle of the axle that is farthest from this one, positive to
            the left [m]; infinite straight on.
        kerb_circle: (n,) diameter of the circle of the outermost wheel's contact point, a tire's radius below its
            centre in its middle plane [m].
        status: (n,) `RowStatus`.
        reason: (n,) texts: why a state is not reached; empty of the others.
    """

    axle: int
    steering: Array
    handwheel: Array
    steer: Array
    ratio: Array
    toe: Array
    camber: Array
    ackermann_difference: Array
    ackermann: Array
    turn_radius: Array
    kerb_circle: Array
    status: Statuses
    reason: Reasons

    def _readable_title(self) -> str:
        return f" of axle {self.axle}: {plural(len(self.status), 'state')}"

    def _readable_rows(self) -> Mapping[str, Row]:
        return {name: f"{value:.4g}" for name, value in self.parameters().items()}

    def rows(self) -> RigRows:
        """States as rows; angles in degrees."""
        columns: dict[str, npt.NDArray[Any]] = {
            "steering": self.steering, "handwheel_deg": np.rad2deg(self.handwheel),
            "steer_L_deg": np.rad2deg(self.steer[:, 0]), "steer_R_deg": np.rad2deg(self.steer[:, 1]),
            "ratio": self.ratio, "toe_L_deg": np.rad2deg(self.toe[:, 0]), "toe_R_deg": np.rad2deg(self.toe[:, 1]),
            "camber_L_deg": np.rad2deg(self.camber[:, 0]), "camber_R_deg": np.rad2deg(self.camber[:, 1]),
            "ackermann_difference_deg": np.rad2deg(self.ackermann_difference),
            "ackermann_percent": 1e2 * self.ackermann, "turn_radius_m": self.turn_radius,
            "kerb_circle_m": self.kerb_circle,
        }  # fmt: skip
        return RigRows(columns, self.status, self.reason, ("steering", "handwheel_deg"))

    def parameters(self) -> dict[str, float]:
        """What a data sheet has of the steering; keys name units, such as [m]. Locks that are not reached are NaN."""
        left, right, middle = -1, 0, len(self.status) // 2
        return {
            "ratio_on_centre": float(self.ratio[middle]),
            "handwheel_lock_deg": math.degrees(self.handwheel[left]),
            "inner_at_left_lock_deg": math.degrees(self.steer[left, 0]),
            "outer_at_left_lock_deg": math.degrees(self.steer[left, 1]),
            "inner_at_right_lock_deg": math.degrees(-self.steer[right, 1]),
            "outer_at_right_lock_deg": math.degrees(-self.steer[right, 0]),
            "ackermann_at_left_lock_percent": 1e2 * float(self.ackermann[left]),
            "ackermann_at_right_lock_percent": 1e2 * float(self.ackermann[right]),
            "toe_at_left_lock_deg": math.degrees(self.toe[left].sum()),
            "toe_at_right_lock_deg": math.degrees(self.toe[right].sum()),
            "turning_circle_left_m": float(self.kerb_circle[left]),
            "turning_circle_right_m": float(self.kerb_circle[right]),
        }


def run_steering_rig(
    spec: VehicleSpec, axle: int | None = None, *, points: int = 61, box_ratio: float = 1.0, device: str = "cpu"
) -> SteeringCurve:
    """Angles of an axle's wheels over the handwheel, from the right lock to the left one, in one batch.

    Args:
        spec: the vehicle.
        axle: index, from the front; None: the first one that is steered.
        points: of the sweep; the middle one of an odd number is straight on.
        box_ratio: ratio of the handwheel's angle to that of the steering's arm or pinion: of a steering box, which is
            not part of the description of a vehicle.
        device: that closes the linkages.

    Raises:
        SpecError: no such axle, or one that is not steered; an empty range.
    """
    chosen = _steered(spec, axle)
    mount = spec.axles[chosen].steering
    assert mount is not None
    if points < 3:
        raise SpecError(f"points: must be 3 or more from lock to lock, got {points}")
    if not (math.isfinite(box_ratio) and box_ratio > 0.0):
        raise SpecError(f"box_ratio: must be > 0, got {box_ratio:g}; 1 is that of a pinion on the handwheel's shaft")
    inputs = np.linspace(-1.0, 1.0, points)
    tables = [
        travel_table(spec, index, 0.0, 0.0 if part.steering is None else inputs, device=device)
        for index, part in enumerate(spec.axles)
    ]
    return _measured(spec, chosen, inputs, box_ratio * spec.steerings[mount].steering.max_angle, tables)


def _steered(spec: VehicleSpec, axle: int | None) -> int:
    steered = [index for index, part in enumerate(spec.axles) if part.steering is not None]
    if not steered:
        raise SpecError(f"axle: '{spec.name}' has no steered axle; take a vehicle with one")
    if axle is None:
        return steered[0]
    if checked_axle(spec, axle).steering is None:
        raise SpecError(f"axle: must be a steered one of '{spec.name}' ({', '.join(map(str, steered))}), got {axle}")
    return axle


def _measured(spec: VehicleSpec, axle: int, inputs: Array, lock: float, tables: Sequence[TravelTable]) -> SteeringCurve:
    table = tables[axle]
    handwheel = inputs * lock
    centers = _of_all_wheels([each.center[..., :2] for each in tables], len(inputs))
    turning = _turning_points(centers, _of_all_wheels([each.steer for each in tables], len(inputs)))
    contacts = _of_all_wheels(
        [
            contact_points(each.center, each.axis, part.tire.radius)[..., :2]
            for each, part in zip(tables, spec.axles, strict=True)
        ],
        len(inputs),
    )
    other = max(range(len(spec.axles)), key=lambda k: abs(spec.axles[k].location[0] - spec.axles[axle].location[0]))
    middle = centers[:, 2 * other : 2 * other + 2].mean(axis=1)
    mean = table.steer.mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = (turning - middle)[:, 1]
        away = np.linalg.norm(contacts - turning[:, None], axis=2)
        ratio = 1.0 / slopes(mean, handwheel, table.reached)
    wheelbase = abs(centers[:, 2 * axle : 2 * axle + 2, 0].mean(axis=1) - middle[:, 0])
    track = centers[:, 2 * axle, 1] - centers[:, 2 * axle + 1, 1]
    wanted = ackermann_difference(table.steer, wheelbase, track)
    inner = np.where(mean > 0.0, table.steer[:, 0], -table.steer[:, 1])
    outer = np.where(mean > 0.0, table.steer[:, 1], -table.steer[:, 0])
    share = np.divide(inner - outer, wanted, out=np.full(len(inputs), np.nan), where=np.abs(wanted) > 1e-9)
    status = np.where(table.reached, RowStatus.DONE, RowStatus.DIVERGED).astype(np.int8)
    return SteeringCurve(
        axle, inputs, handwheel, table.steer, ratio, table.toe, table.camber, wanted, share, radius,
        2.0 * away.max(axis=1), status, table.reason,
    )  # fmt: skip


def ackermann_difference(steer: Array, wheelbase: npt.ArrayLike, track: npt.ArrayLike) -> Array:
    """(n,) by which an inner wheel turns further than the outer one if both roll about one point of the rear axle's
    line, for the angle that the inner wheel has [rad].

    Args:
        steer: (n, 2) headings of the left and the right wheel, positive to the left [rad].
        wheelbase: (n,) or one, from that line to the wheels [m].
        track: (n,) or one, between the wheels [m].
    """
    mean = steer.mean(axis=1)
    inner = np.where(mean > 0.0, steer[:, 0], -steer[:, 1])
    safe = np.where(np.abs(inner) > 1e-9, inner, 1.0)
    outer = np.arctan(1.0 / (1.0 / np.tan(safe) + np.asarray(track) / np.asarray(wheelbase)))
    return np.where(np.abs(inner) > 1e-9, inner - outer, 0.0)


def _of_all_wheels(axles: Sequence[Array], states: int) -> Array:
    """(n, wheels, ...) values of all wheels from (n, 2, ...) of each axle; (1, 2, ...) of one that is not steered."""
    return np.concatenate([np.broadcast_to(values, (states, *values.shape[1:])) for values in axles], axis=1)


def _turning_points(centers: Array, headings: Array) -> Array:
    """(n, 2) point from which the lines of all wheels' axes are least far, by squares; infinite where all are parallel.

    A point p lies on the axis of a wheel at c that heads along f if f · (p - c) = 0.
    """
    forward = np.stack([np.cos(headings), np.sin(headings)], axis=2)
    right = np.einsum("nwi,nwi->nw", forward, centers)
    square = np.einsum("nwi,nwj->nij", forward, forward)
    found = np.full((len(centers), 2), np.inf)
    turning = np.abs(np.linalg.det(np.nan_to_num(square))) > 1e-9
    target = np.einsum("nwi,nw->ni", forward, right)
    found[turning] = np.linalg.solve(square[turning], target[turning][..., None])[..., 0]
    return found
