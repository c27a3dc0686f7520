"""What a bench measures of an axle: curves over its motions, and characteristic values.

Wheels are those of the axle, columns left and right. Travel is that of the wheels' centres upwards from the state in
which the vehicle stands on level ground, or from the state as built. Angles follow the usual signs of a bench: toe is
positive inwards, camber where the top leans outwards, caster where the steering axis leans back, its inclination where
it leans inwards.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import Names, Readable, Row, plural
from simwarp.vehicle.rigs.rig_rows import Reasons, RigRows, Statuses, joined_rows
from simwarp.vehicle.rigs.standing_loads import StandingLoads
from simwarp.vehicle.spec.parts import Array


class SuspensionReference(enum.Enum):
    """State from which travel counts, and at which parameters are given."""

    STANDING = "standing"
    """The vehicle stands on level ground; as BUILT for an axle without springs of its own."""
    BUILT = "built"
    """As the description of the vehicle has it."""


class SuspensionMotion(enum.Enum):
    """What a bench does with an axle."""

    PARALLEL = "parallel"
    """Both wheels travel alike."""
    OPPOSITE = "opposite"
    """The right wheel goes down as the left one goes up."""
    STEERING = "steering"
    """The steering goes from lock to lock in the state of reference."""


@dataclasses.dataclass(frozen=True, repr=False)
class SuspensionCurve(Readable):
    """An axle over one motion of the bench; n states, columns left and right. NaN where a state is not DONE, but for
    the travel, which is what was asked.

    Attributes:
        motion: of the bench.
        travel: (n, 2) of the wheels' centres upwards from the state of reference [m].
        steering: (n,) ratio of the steering's travel, -1 to 1, positive to the left.
        steer: (n, 2) heading of the wheels, positive to the left [rad].
        toe: (n, 2) positive inwards [rad].
        camber: (n, 2) positive where the top leans outwards [rad].
        track_change: (n,) of the distance of the contact points across, from the state of reference [m].
        wheelbase_change: (n, 2) of the contact points forwards, likewise [m].
        caster: (n, 2) of the steering axis, positive where its top leans back [rad].
        kingpin_inclination: (n, 2) positive where its top leans inwards [rad].
        scrub_radius: (n, 2) from the steering axis out to the contact point, on the ground [m].
        trail: (n, 2) from the contact point forwards to the steering axis, on the ground [m].
        roll_centre: (n, 2) of both contact points' normals in front view: y to the left, height above the ground [m].
        anti_dive: (n, 2) share of the load transfer in braking that the linkage bears: anti-dive of a front axle,
            anti-lift of a rear one, see `braking_name`.
        anti_squat: (n, 2) the same in driving, all of the force on this axle, by shafts whose torque the chassis bears:
            anti-squat of a rear axle, anti-lift of a front one, see `driving_name`.
        motion_ratio: (n, 2, lines) ratio of the springs' and dampers' compression to the travel, in parallel travel.
        spring_load: (n, 2) vertical force on a wheel that holds springs and anti-roll bar there [N].
        wheel_load: (n, 2) the same with the weight of wheel and links [N].
        into_stop: (n, 2) how far a spring of the wheel is in its bump stop (positive) or its rebound stop (negative)
            [m]; 0: all are free.
        wheel_rate: (n, 2) rise of the springs' load over the travel in this motion, with what stops add [N/m]; NaN when
            steering.
        free_wheel_rate: (n, 2) the same without what stops add [N/m].
        roll_stiffness: (n,) of springs and anti-roll bar about the roll angle of the axle [N·m/rad]; NaN but in the
            opposite motion.
        free_roll_stiffness: (n,) the same without what stops add [N·m/rad].
        status: (n,) `RowStatus`.
        reason: (n,) texts: why a state is not reached; empty of the others.
        front: whether the axle is ahead of the middle of all axles.
        driven: whether the vehicle's driveline drives it.
    """

    motion: SuspensionMotion
    travel: Array
    steering: Array
    steer: Array
    toe: Array
    camber: Array
    track_change: Array
    wheelbase_change: Array
    caster: Array
    kingpin_inclination: Array
    scrub_radius: Array
    trail: Array
    roll_centre: Array
    anti_dive: Array
    anti_squat: Array
    motion_ratio: Array
    spring_load: Array
    wheel_load: Array
    into_stop: Array
    wheel_rate: Array
    free_wheel_rate: Array
    roll_stiffness: Array
    free_roll_stiffness: Array
    status: Statuses
    reason: Reasons
    front: bool
    driven: bool

    @property
    def braking_name(self) -> str:
        """What the share in braking is called: of a front axle anti-dive, of a rear one anti-lift."""
        return "anti_dive" if self.front else "anti_lift"

    @property
    def driving_name(self) -> str:
        """What the share in driving is called: of a front axle anti-lift, of a rear one anti-squat."""
        return "anti_lift" if self.front else "anti_squat"

    def stop_names(self, column: int) -> npt.NDArray[np.str_]:
        """(n,) "bump" or "rebound" where a spring of a wheel is in that stop, else empty.

        Args:
            column: 0 of the left wheel, 1 of the right one.
        """
        into = self.into_stop[:, column]
        return np.select([into > 0.0, into < 0.0], ["bump", "rebound"], "")

    def _readable_title(self) -> str:
        return f": {self.motion.value}, {plural(len(self.status), 'state')}"

    def rows(self) -> RigRows:
        """States as rows; angles in degrees, lengths of the linkage in mm."""
        columns: dict[str, npt.NDArray[Any]] = {
            "motion": np.full(len(self.status), self.motion.value), "steering": self.steering,
        }  # fmt: skip
        for column, side in enumerate("LR"):
            columns |= {
                f"travel_{side}_mm": 1e3 * self.travel[:, column],
                f"steer_{side}_deg": np.rad2deg(self.steer[:, column]),
                f"toe_{side}_deg": np.rad2deg(self.toe[:, column]),
                f"camber_{side}_deg": np.rad2deg(self.camber[:, column]),
                f"caster_{side}_deg": np.rad2deg(self.caster[:, column]),
                f"kingpin_inclination_{side}_deg": np.rad2deg(self.kingpin_inclination[:, column]),
                f"scrub_radius_{side}_mm": 1e3 * self.scrub_radius[:, column],
                f"trail_{side}_mm": 1e3 * self.trail[:, column],
                f"wheelbase_change_{side}_mm": 1e3 * self.wheelbase_change[:, column],
                f"{self.braking_name}_{side}_percent": 1e2 * self.anti_dive[:, column],
                f"spring_load_{side}_N": self.spring_load[:, column],
                f"wheel_load_{side}_N": self.wheel_load[:, column],
                f"wheel_rate_{side}_N_per_mm": 1e-3 * self.wheel_rate[:, column],
                f"free_wheel_rate_{side}_N_per_mm": 1e-3 * self.free_wheel_rate[:, column],
                f"stop_{side}": self.stop_names(column),
                f"into_stop_{side}_mm": 1e3 * self.into_stop[:, column],
            }
            if self.driven:
                columns[f"{self.driving_name}_{side}_percent"] = 1e2 * self.anti_squat[:, column]
            for line in range(self.motion_ratio.shape[2]):
                columns[f"motion_ratio{line}_{side}"] = self.motion_ratio[:, column, line]
        columns |= {
            "track_change_mm": 1e3 * self.track_change, "roll_centre_y_mm": 1e3 * self.roll_centre[:, 0],
            "roll_centre_height_mm": 1e3 * self.roll_centre[:, 1],
            "roll_stiffness_Nm_per_deg": self.roll_stiffness * math.pi / 180.0,
            "free_roll_stiffness_Nm_per_deg": self.free_roll_stiffness * math.pi / 180.0,
        }  # fmt: skip
        return RigRows(columns, self.status, self.reason, ("motion", "travel_L_mm", "steering"))


@dataclasses.dataclass(frozen=True, repr=False)
class SuspensionRun(Readable):
    """What a bench measured of an axle.

    Attributes:
        axle: its index, from the front.
        curves: by motion; an axle that is not steered has none of the steering, a pinned one none in parallel.
        loads: masses and wheel loads of the vehicle.
        reference_travel: of the wheels' centres from the state as built to that of reference [m].
        interrupted: True where a motion is missing because the run was interrupted.
    """

    axle: int
    curves: Mapping[SuspensionMotion, SuspensionCurve]
    loads: StandingLoads
    reference_travel: float
    interrupted: bool = False

    @property
    def front(self) -> bool:
        """Whether the axle is ahead of the middle of all axles."""
        return next(iter(self.curves.values())).front

    def _readable_title(self) -> str:
        return f" of axle {self.axle}"

    def _readable_rows(self) -> Mapping[str, Row]:
        return {"motions": Names(len(self.curves), (motion.value for motion in self.curves))}

    def rows(self) -> RigRows:
        """States of all motions as rows."""
        return joined_rows([curve.rows() for curve in self.curves.values()])

    def parameters(self) -> dict[str, float]:
        """Values of the left wheel in the state of reference and their slopes; keys name units, such as [N/mm]."""
        return _parameters(self)


def _parameters(run: SuspensionRun) -> dict[str, float]:
    found: dict[str, float] = {
        "reference_travel_mm": 1e3 * run.reference_travel, "wheel_load_N": float(run.loads.wheel_load[run.axle]),
    }  # fmt: skip
    curve = next(iter(run.curves.values()))
    middle = len(curve.status) // 2
    degrees = {
        "toe_deg": curve.toe, "camber_deg": curve.camber, "caster_deg": curve.caster,
        "kingpin_inclination_deg": curve.kingpin_inclination,
    }  # fmt: skip
    found |= {name: math.degrees(values[middle, 0]) for name, values in degrees.items()}
    found |= {
        "scrub_radius_mm": 1e3 * float(curve.scrub_radius[middle, 0]), "trail_mm": 1e3 * float(curve.trail[middle, 0]),
        "roll_centre_height_mm": 1e3 * float(curve.roll_centre[middle, 1]),
        f"{curve.braking_name}_percent": 1e2 * float(curve.anti_dive[middle, 0]),
    }  # fmt: skip
    if curve.driven:
        found[f"{curve.driving_name}_percent"] = 1e2 * float(curve.anti_squat[middle, 0])
    found["into_stop_mm"] = 1e3 * float(curve.into_stop[middle, 0])
    found |= {f"motion_ratio{k}": float(v) for k, v in enumerate(curve.motion_ratio[middle, 0])}
    parallel, opposite = (run.curves.get(m) for m in (SuspensionMotion.PARALLEL, SuspensionMotion.OPPOSITE))
    if parallel is not None:
        travel = parallel.travel[:, 0]
        found |= {
            "toe_gain_deg_per_m": math.degrees(np.gradient(parallel.toe[:, 0], travel)[middle]),
            "camber_gain_deg_per_m": math.degrees(np.gradient(parallel.camber[:, 0], travel)[middle]),
            "track_gain_mm_per_m": 1e3 * float(np.gradient(parallel.track_change, travel)[middle]),
            "wheel_rate_N_per_mm": 1e-3 * float(parallel.wheel_rate[middle, 0]),
            "free_wheel_rate_N_per_mm": 1e-3 * float(parallel.free_wheel_rate[middle, 0]),
        }
    if opposite is not None:
        track = float(run.loads.track[run.axle])
        roll = np.arctan2(np.subtract(*opposite.travel.T), track)
        found |= {
            "roll_stiffness_Nm_per_deg": float(opposite.roll_stiffness[middle]) * math.pi / 180.0,
            "free_roll_stiffness_Nm_per_deg": float(opposite.free_roll_stiffness[middle]) * math.pi / 180.0,
            "roll_steer_deg_per_deg": float(np.gradient(opposite.steer.mean(axis=1), roll)[middle]),
            "roll_camber_deg_per_deg": float(np.gradient(opposite.camber[:, 0], roll)[middle]),
        }
    return found
