"""A tilt table: the angle at which the first wheel of a vehicle lifts, every angle a world.

The table tilts about the vehicle's longitudinal axis, slowly, and stands; wheels hold by friction. In the rig the table
stays level and gravity turns.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import Readable, Row, plural
from simwarp.vehicle.rigs.post_rig import PostRig
from simwarp.vehicle.rigs.rig_rows import Progress, Reasons, RigRows, RowStatus, Statuses
from simwarp.vehicle.spec.parts import Array, SpecError
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec

SETTLE: Final = 2.0
"""On the level table [s]."""
RAMP: Final = 4.0
"""To the angle [s]."""
HOLD: Final = 2.0
"""At the angle [s]."""
LIFTED: Final = 1.0e-3
"""Share of the mean wheel load below which a wheel has lifted."""
UNBORNE: Final = 0.05
"""Share of the weight that the wheels may not bear in a state at rest."""
LYING: Final = 0.25 * math.pi
"""Roll of the chassis on the table beyond which a vehicle lies on its side [rad]."""
BEYOND: Final = 1.15
"""Largest angle as a share of the rigid vehicle's."""


@dataclasses.dataclass(frozen=True, repr=False)
class TiltTable(Readable):
    """A vehicle on a tilt table; n angles. NaN where a world is not DONE: one that tipped over is TIPPED.

    Attributes:
        angle: (n,) of the table, positive where the left side is raised [rad].
        load: (n, wheels) vertical forces on the table [N].
        roll: (n,) of the chassis on the table, positive to the right [rad].
        lift_angle: of the table at which the first wheel lifts [rad]; NaN where none does, or not after two angles at
            which it stands.
        lifted_wheel: its index; -1 where none does.
        track: between the points of contact, of the axle whose wheel lifts, else of the first one [m].
        com_height: of the centre of mass above the level table [m].
        status: (n,) `RowStatus`.
        reason: (n,) texts: how a world tipped over or diverged; empty of the others.
    """

    angle: Array
    load: Array
    roll: Array
    lift_angle: float
    lifted_wheel: int
    track: float
    com_height: float
    status: Statuses
    reason: Reasons

    @property
    def static_stability_factor(self) -> float:
        """The ratio of the track to twice the height of the centre of mass."""
        return self.track / (2.0 * self.com_height)

    @property
    def rigid_angle(self) -> float:
        """Angle at which a rigid vehicle tips: the arc tangent of the static stability factor [rad]."""
        return math.atan(self.static_stability_factor)

    def _readable_title(self) -> str:
        return f": first lift at {math.degrees(self.lift_angle):.4g}° of {plural(len(self.angle), 'angle')}"

    def _readable_rows(self) -> Mapping[str, Row]:
        return {"rigid vehicle": f"{math.degrees(self.rigid_angle):.4g}°"}

    def rows(self) -> RigRows:
        """Angles as rows, in degrees."""
        columns: dict[str, npt.NDArray[Any]] = {
            "angle_deg": np.rad2deg(self.angle), "roll_deg": np.rad2deg(self.roll),
        }  # fmt: skip
        columns |= {f"load{k}_N": self.load[:, k] for k in range(self.load.shape[1])}
        return RigRows(columns, self.status, self.reason, ("angle_deg",))

    def parameters(self) -> dict[str, float]:
        """Characteristic values; keys name units, such as [m]."""
        return {
            "lift_angle_deg": math.degrees(self.lift_angle), "lifted_wheel": float(self.lifted_wheel),
            "static_stability_factor": self.static_stability_factor,
            "rigid_angle_deg": math.degrees(self.rigid_angle),
            "tangent_of_lift_angle": math.tan(self.lift_angle), "track_m": self.track, "com_height_m": self.com_height,
        }  # fmt: skip


def run_tilt_table(
    spec: VehicleSpec, *, angles: npt.ArrayLike | None = None, points: int = 25, dt: float = 1.0e-3,
    device: str = "cpu", progress: Progress | None = None,
) -> TiltTable:  # fmt: skip
    """Loads of a vehicle's wheels over the angle of a tilt table.

    Args:
        spec: the vehicle.
        angles: (n,) of the table, increasing from 0, positive where the left side is raised [rad]; None: up to 115 % of
            the angle at which a rigid vehicle would tip.
        points: n where no angles are given.
        dt: time step [s].
        device: that runs the worlds.
        progress: is called with the share that is done.

    Raises:
        SpecError: an empty range, or a tire that makes no forces of its own.
    """
    if points < 3:
        raise SpecError(f"points: must be 3 or more angles, got {points}")
    given = None if angles is None else np.atleast_1d(np.asarray(angles, np.float64))
    if given is not None and (len(given) < 3 or given[0] != 0.0 or not (np.diff(given) > 0.0).all()):
        raise SpecError("angles: must be three or more, increasing from 0; the range would be empty otherwise")
    if given is not None and not given[-1] < 0.5 * math.pi:
        raise SpecError(f"angles: must be below a right angle, got {given[-1]:g} rad")
    rig = PostRig(spec, points if given is None else len(given), dt=dt, device=device)
    total = round((SETTLE + RAMP + HOLD) / dt)
    settling, ramp = round(SETTLE / dt), round(RAMP / dt)
    target = np.zeros(rig.simulation.model.world_count)
    finished = False
    built = (0.0, np.zeros(0))
    try:
        for step in range(total):
            if step == settling:
                built = float(rig.centre_of_mass()[0, 2]), _tracks(rig)
                rigid = math.atan(float(built[1].min()) / (2.0 * built[0]))
                target = np.linspace(0.0, BEYOND * rigid, points) if given is None else given
            if settling <= step <= settling + ramp:
                share = (step - settling) / ramp
                rig.tilt(target * share * share * (3.0 - 2.0 * share))
            rig.step()
            if progress is not None and step % 100 == 0:
                progress(step / total)
        finished = True
    except KeyboardInterrupt:
        if len(built[1]) == 0:
            raise
    return _read(rig, target, built[0], built[1], finished)


def _tracks(rig: PostRig) -> Array:
    """(A,) distances between the contact points of the first world's axles, which is that of their centres [m]."""
    y = rig.wheel_places()[0, :, 1]
    return np.asarray(y[0::2] - y[1::2])


def _read(rig: PostRig, angle: Array, height: float, tracks: Array, finished: bool) -> TiltTable:
    load, roll = rig.loads(), rig.chassis_motion()[:, 1]
    weight = rig.mass * float(np.linalg.norm(rig.vehicle.model.builder.gravity)) * np.cos(angle)
    tipped = np.abs(roll) > LYING
    if finished:  # a vehicle that falls, or lies on its side, does not stand on its wheels
        tipped |= ~(np.abs(load.sum(axis=1) - weight) < UNBORNE * weight)
    kind = RowStatus.DONE if finished else RowStatus.UNFINISHED
    status = np.where(tipped, RowStatus.TIPPED, kind).astype(np.int8)
    for row in np.flatnonzero(tipped).tolist():
        share = 100.0 * load[row].sum() / weight[row]
        rig.reason[row] = rig.reason[row] or (
            f"tipped over: the chassis rolls by {math.degrees(roll[row]):.0f}°, wheels bear {share:.0f} % of the weight"
        )
    status[rig.broken()] = RowStatus.DIVERGED
    load[status != RowStatus.DONE] = np.nan
    roll[status != RowStatus.DONE] = np.nan
    lift, wheel = first_lift(angle, load)
    axle = 0 if wheel < 0 else wheel // 2
    return TiltTable(angle, load, roll, lift, wheel, float(tracks[axle]), height, status, rig.reason)


def first_lift(angle: Array, load: Array) -> tuple[float, int]:
    """Angle at which the first wheel bears nothing, and that wheel; (NaN, -1) where none lifts.

    From the last two angles at which all wheels stand, the load of the wheel that lifts goes on along a line.

    Args:
        angle: (n,) increasing [rad].
        load: (n, wheels) [N]; NaN where it is not known.
    """
    least = LIFTED * float(np.nanmean(load[0]))
    best, found = math.inf, -1
    for wheel in range(load.shape[1]):
        values = load[:, wheel]
        gone = np.flatnonzero(~(values > least))
        if len(gone) == 0 or gone[0] < 2:
            continue
        low, high = gone[0] - 2, gone[0] - 1
        slope = (values[high] - values[low]) / (angle[high] - angle[low])
        if not slope < 0.0:
            continue
        at = float(angle[high] - values[high] / slope)
        if at < best:
            best, found = at, wheel
    return (math.nan, -1) if found < 0 else (best, found)
