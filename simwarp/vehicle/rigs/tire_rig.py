"""The tire machine: steady forces of a tire over slip, slip angle, inclination, load and speed, one batch.

A wheel is led over a flat road with a prescribed velocity and spin; each point of a sweep is a world, and its forces
are those of the kernel that drives vehicles (`Tires`). The height is the one at which the tire bears the load.

Axes are those of ISO 8855 at the contact point (W): X along the wheel's plane, Y to the left, Z upwards; forces and
moments are those of the road on the tire. A slip angle is positive where the wheel drifts to the left, so that F_y is
negative there; an inclination is positive where the wheel's top leans to the right.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.object_repr import Readable, Row, plural
from simwarp.kernels.core.fields import StateArrays
from simwarp.vehicle.rigs.rig_rows import Progress, Reasons, RigRows, RowStatus, Statuses, no_reasons
from simwarp.vehicle.spec.parts import Array, SpecError
from simwarp.vehicle.spec.vehicle_parts import Tire
from simwarp.vehicle.tires.parameter_vector import MODELS
from simwarp.vehicle.tires.parameter_vector_kernels import Common
from simwarp.vehicle.tires.tires import Mount, ParameterVector, Tires, tire_vector

STEP: Final = 1.0e-3
"""Of the bristles of tires that have some [s]."""
ROUND: Final = 100
"""Steps between two looks at whether the forces still change."""
MOST_ROUNDS: Final = 60
SETTLED: Final = 1.0e-5
"""Change of a force in a round, as a share of the load, below which a point is steady."""
HALVINGS: Final = 40
"""Of the range of deflections in which a load is looked for."""
DEEPEST: Final = 0.5
"""Largest deflection of a tire, as a share of its radius."""
LOAD_ERROR: Final = 1.0e-3
"""Share of a load by which a point may miss it; beyond, the tire does not bear it."""
SMALL_SLIP: Final = 1.0e-4
"""Slip, and slip angle [rad], on either side of zero, between which stiffnesses are measured."""


WIDE_SLIP: Final = 1.0
"""Slip ratio up to which peaks are looked for, whatever the sweep: that of a locked wheel."""
WIDE_ANGLE: Final = 0.8
"""The same of slip angles [rad]."""
WIDE_POINTS: Final = 401
"""Of a sweep for peaks, from one end to the other."""


@dataclasses.dataclass(frozen=True, repr=False)
class TireForces(Readable):
    """Steady states of a tire; arrays of one shape (...,). NaN where a point is not DONE.

    Attributes:
        slip_ratio: (...,) ratio, positive when driving.
        slip_angle: (...,) positive where the wheel drifts to the left [rad].
        inclination: (...,) positive where the wheel's top leans to the right [rad].
        load: (...,) vertical force of the road, F_z [N].
        speed: (...,) of the wheel's centre [m/s].
        fx, fy: (...,) forces of the road in its plane [N].
        mx, my, mz: (...,) overturning, rolling and aligning moment about the contact point [N·m].
        deflection: (...,) vertical [m].
        status: (...,) `RowStatus`.
        reason: (...,) texts: why a point is not DONE; empty of the others.
    """

    slip_ratio: Array
    slip_angle: Array
    inclination: Array
    load: Array
    speed: Array
    fx: Array
    fy: Array
    mx: Array
    my: Array
    mz: Array
    deflection: Array
    status: Statuses
    reason: Reasons

    def _readable_title(self) -> str:
        return f": {plural(self.load.size, 'point')}"

    def __getitem__(self, index: Any) -> TireForces:
        """Some of the points: every array at an index."""
        return TireForces(**{field.name: getattr(self, field.name)[index] for field in dataclasses.fields(self)})

    def reshaped(self, shape: tuple[int, ...]) -> TireForces:
        """Returns the same points in arrays (...,) of another shape."""
        return TireForces(
            **{field.name: getattr(self, field.name).reshape(shape) for field in dataclasses.fields(self)}
        )

    def rows(self, tire: str = "") -> RigRows:
        """Points as rows; angles in degrees."""
        flat = self.reshaped((-1,))
        columns: dict[str, npt.NDArray[Any]] = {"tire": np.full(flat.load.shape, tire)} if tire else {}
        columns |= {
            "slip_ratio": flat.slip_ratio, "slip_angle_deg": np.rad2deg(flat.slip_angle),
            "inclination_deg": np.rad2deg(flat.inclination), "speed_mps": flat.speed, "Fz_N": flat.load,
            "Fx_N": flat.fx, "Fy_N": flat.fy, "Mx_Nm": flat.mx, "My_Nm": flat.my, "Mz_Nm": flat.mz,
            "deflection_m": flat.deflection,
        }  # fmt: skip
        asked = ("slip_ratio", "slip_angle_deg", "inclination_deg", "speed_mps", "Fz_N")
        return RigRows(columns, flat.status, flat.reason, (*(("tire",) if tire else ()), *asked))


def tire_forces(
    tire: Tire, *, slip_ratio: npt.ArrayLike = 0.0, slip_angle: npt.ArrayLike = 0.0, inclination: npt.ArrayLike = 0.0,
    load: npt.ArrayLike, speed: npt.ArrayLike = 20.0, friction: float | None = None, device: str = "cpu",
    progress: Progress | None = None,
) -> TireForces:  # fmt: skip
    """Steady forces of a tire that rolls over a flat road. Arguments broadcast against each other to (...,) points.

    An interruption leaves what has settled; the other points are UNFINISHED.

    Args:
        tire: its description, of a template that makes forces of its own (not rigid, flexible or on soil).
        slip_ratio: (...,) ratio, positive when driving.
        slip_angle: (...,) positive where the wheel drifts to the left [rad].
        inclination: (...,) positive where the wheel's top leans to the right [rad].
        load: (...,) vertical force [N].
        speed: (...,) of the wheel's centre [m/s].
        friction: of the road; that on which the tire was measured when None.
        device: that evaluates the kernel.
        progress: is called with the share that is done.

    Raises:
        SpecError: the tire makes no forces of its own, or a load or speed is not above zero.
    """
    vector = rig_vector(tire)
    given = [np.asarray(each, np.float64) for each in (slip_ratio, slip_angle, inclination, load, speed)]
    for name, values in zip(("load", "speed"), given[3:], strict=True):
        if not (np.isfinite(values) & (values > 0.0)).all():
            raise SpecError(f"{name}: must be > 0, got {float(np.min(values)):g}; give the load [N] and speed [m/s]")
    shape = np.broadcast_shapes(*(each.shape for each in given))
    points = [np.ravel(np.broadcast_to(each, shape)) for each in given]
    road = float(vector.values[Common.REFERENCE_FRICTION]) if friction is None else friction
    machine = _Machine(vector, tire.radius, points, road, device)
    machine.settle(progress)
    return machine.read().reshaped(shape)


def rig_vector(tire: Tire) -> ParameterVector:
    """The parameters of a tire that a rig can hold.

    Raises:
        SpecError: its template makes no forces of its own.
    """
    if tire.template not in MODELS:
        rule = f"one of {', '.join(MODELS)}, whose law a rig can evaluate"
        raise SpecError(f"tire: template must be {rule}, got '{tire.template}'; take another tire")
    return tire_vector(tire)


def static_deflection(tire: Tire, load: npt.ArrayLike, *, device: str = "cpu") -> Array:
    """(...,) deflection of an upright tire under loads (...,) [N], in m.

    Raises:
        SpecError: the tire makes no forces of its own, a load is not above zero, or it is beyond what the tire bears.
    """
    found = tire_forces(tire, load=load, device=device)
    if (found.status == RowStatus.DIVERGED).any():
        raise SpecError(f"load: must be one that the tire bears, got {float(np.max(np.asarray(load))):.4g} N")
    return found.deflection


class _Machine:
    """Worlds of one wheel each, led over the plane z = 0.

    Attributes:
        tires: the element with the forces.
        deflection: (n,) under the load [m].
        steady: (n,) whether forces do not change any more.
        interrupted: whether the roll was.
    """

    def __init__(
        self, vector: ParameterVector, radius: float, points: list[Array], friction: float, device: str
    ) -> None:
        self.slip, self.angle, self.lean, self.load, self.speed = points
        self.vector, self.radius = vector, radius
        self.count = len(self.load)
        self.tires = Tires([Mount(vector, 0)], self.count, 1, device, friction=friction)
        self.device = self.tires.device
        self.steady = np.zeros(self.count, bool)
        self.interrupted = False
        self.change = np.zeros(self.count)
        half = 0.5 * self.lean
        turn = np.stack([np.sin(half), 0.0 * half, 0.0 * half, np.cos(half)], axis=1)
        self.state: Any = StateArrays()
        self.state.body_rot = wp.array(turn[:, None], dtype=wp.quatd, device=self.device)
        velocity = np.stack([np.cos(self.angle), np.sin(self.angle), 0.0 * self.angle], axis=1) * self.speed[:, None]
        self.state.body_v = wp.array(velocity[:, None], dtype=wp.vec3, device=self.device)
        self.deflection = self._loaded_deflection()

    def _place(self, deflection: Array) -> None:
        """Set heights and spins of wheels that are deflected so."""
        height = self._height(deflection)
        x = np.stack([0.0 * height, 0.0 * height, height], axis=1)
        self.state.body_x = wp.array(x[:, None], dtype=wp.vec3d, device=self.device)
        effective = self.radius - float(self.vector.values[Common.RADIUS_SHARE]) * deflection
        spin = self.speed * np.cos(self.angle) * (1.0 + self.slip) / effective
        axis = np.stack([0.0 * self.lean, np.cos(self.lean), np.sin(self.lean)], axis=1)
        self.state.body_omega = wp.array((spin[:, None] * axis)[:, None], dtype=wp.vec3, device=self.device)

    def _height(self, deflection: Array) -> Array:
        """(n,) heights of the centres at which the kernel finds a deflection: what a disc lacks of its radius to a
        plane through the ground below its lowest point, turned into it.
        """
        cosine = np.cos(self.lean)
        return np.asarray((self.radius * cosine**2 - deflection) / cosine)

    def _loaded_deflection(self) -> Array:
        """(n,) at which the tires bear their loads, by halving."""
        low, high = np.zeros(self.count), np.full(self.count, DEEPEST * self.radius)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            self._place(middle)
            self.tires.apply(STEP, self.state)
            heavy = self.tires.load.numpy()[:, 0] > self.load
            low, high = np.where(heavy, low, middle), np.where(heavy, middle, high)
        self.tires.state.zero_()
        found: Array = 0.5 * (low + high)
        self._place(found)
        return found

    def settle(self, progress: Progress | None) -> None:
        """Roll on until forces are steady; an interruption ends it."""
        last = np.full((self.count, 3), np.inf)
        try:
            for number in range(1, MOST_ROUNDS + 1):
                for _ in range(ROUND):
                    self.tires.apply(STEP, self.state)
                force = self.tires.force_w.numpy()[:, 0].astype(np.float64)
                self.change = change = np.abs(force - last).max(axis=1)
                self.steady = (change < SETTLED * self.load) | ~np.isfinite(force).all(axis=1)
                last = force
                if progress is not None:
                    progress(max(number / MOST_ROUNDS, float(self.steady.mean())))
                if self.steady.all():
                    break
        except KeyboardInterrupt:
            if not self.steady.any():
                raise
            self.interrupted = True

    def read(self) -> TireForces:
        """The points as they are."""
        force = self.tires.force_w.numpy()[:, 0].astype(np.float64)
        torque = self.tires.torque_w.numpy()[:, 0].astype(np.float64)
        load = self.tires.load.numpy()[:, 0].astype(np.float64)
        down = self.radius - self.deflection
        arm = np.stack([0.0 * down, down * np.sin(self.lean), -self._height(self.deflection)], axis=1)
        moment = torque - np.cross(arm, force)
        restless = RowStatus.UNFINISHED if self.interrupted else RowStatus.DIVERGED
        status = np.where(self.steady, RowStatus.DONE, restless).astype(np.int8)
        borne = np.abs(load - self.load) < LOAD_ERROR * self.load
        status[~(np.isfinite(force).all(axis=1) & borne)] = RowStatus.DIVERGED
        finite = np.isfinite(force).all(axis=1)
        measured = np.column_stack([force, moment, self.deflection])
        measured[status != RowStatus.DONE] = np.nan
        bears, load = load, np.where(status == RowStatus.DONE, load, self.load)
        return TireForces(
            self.slip, self.angle, self.lean, load, self.speed, measured[:, 0], measured[:, 1], measured[:, 3],
            measured[:, 4], measured[:, 5], measured[:, 6], status, self._reasons(status, finite, borne, bears),
        )  # fmt: skip

    def _reasons(
        self, status: Statuses, finite: npt.NDArray[np.bool_], borne: npt.NDArray[np.bool_], bears: Array
    ) -> Reasons:
        """(n,) why points diverged."""
        found = no_reasons(self.count)
        for row in np.flatnonzero(status == RowStatus.DIVERGED).tolist():
            if not finite[row]:
                found[row] = "a force of the tire is not finite"
            elif not borne[row]:
                share = 100.0 * self.deflection[row] / self.radius
                found[row] = f"the tire bears {bears[row]:.4g} N at a deflection of {share:.0f} % of its radius"
            else:
                time = MOST_ROUNDS * ROUND * STEP
                found[row] = f"forces do not settle: {self.change[row]:.3g} N in {ROUND * STEP:g} s after {time:g} s"
        return found


@dataclasses.dataclass(frozen=True, kw_only=True)
class TireSweep:
    """What a tire machine goes through: a sweep of the slip ratio at every one of `combined_angles` and without a slip
    angle, and a sweep of the slip angle of the freely rolling wheel; for every load, inclination and speed.
    """

    loads: tuple[float, ...]
    """Vertical forces [N]."""
    inclinations: tuple[float, ...] = (0.0,)
    """[rad], positive where the wheel's top leans to the right."""
    speeds: tuple[float, ...] = (20.0,)
    """[m/s]."""
    slip: float = 0.6
    """Largest slip ratio, in both directions."""
    angle: float = math.radians(15.0)
    """Largest slip angle, in both directions [rad]."""
    points: int = 61
    """Of a curve."""
    combined_angles: tuple[float, ...] = ()
    """Slip angles of further sweeps of the slip ratio [rad]."""
    friction: float | None = None
    """Of the road; None: that on which the tire was measured."""

    def check(self) -> None:
        """Ranges are not empty.

        Raises:
            SpecError: one is.
        """
        for name in ("loads", "inclinations", "speeds"):
            if not getattr(self, name):
                raise SpecError(f"{name}: must hold one value or more, got none")
        for name in ("slip", "angle"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise SpecError(f"{name}: must be > 0, got {value:g}: the range would be empty")
        if self.angle >= 0.5 * math.pi:
            raise SpecError(f"angle: must be below a right angle, got {self.angle:g} rad")
        if self.points < 3:
            raise SpecError(f"points: must be 3 or more of each curve, got {self.points}")


@dataclasses.dataclass(frozen=True, repr=False)
class TireCurves(Readable):
    """What a tire machine measured; L loads, C inclinations, S speeds, P points of a curve.

    Attributes:
        sweep: that was asked for.
        longitudinal: (A, L, C, S, P) over the slip ratio; the first of the A has no slip angle.
        lateral: (L, C, S, P) over the slip angle.
        slip_stiffness: (L, C, S) dF_x over the slip ratio at zero [N].
        cornering_stiffness: (L, C, S) -dF_y over the slip angle at zero [N/rad].
        aligning_stiffness: (L, C, S) dM_z over the slip angle at zero [N·m/rad].
        trail: (L, C, S) pneumatic, at zero slip [m].
        peak_driving, peak_braking: (L, C, S) ratio to the load of the largest F_x in that direction, up to a slip ratio
            of 1 whatever the sweep; a tire whose force grows to the end has it there.
        peak_left, peak_right: (L, C, S) ratio of the largest F_y to either side to the load, up to a slip angle of
            0.8 rad whatever the sweep.
        peak_slip: (L, C, S, 2) slip ratios of the peaks, driving and braking.
        peak_angle: (L, C, S, 2) slip angles of the peaks to the left and to the right [rad].
        load_sensitivity: (2, C, S) slopes of the mean peaks over the load, longitudinal and lateral [1/N]; NaN for one
            load.
    """

    sweep: TireSweep
    longitudinal: TireForces
    lateral: TireForces
    slip_stiffness: Array
    cornering_stiffness: Array
    aligning_stiffness: Array
    trail: Array
    peak_driving: Array
    peak_braking: Array
    peak_left: Array
    peak_right: Array
    peak_slip: Array
    peak_angle: Array
    load_sensitivity: Array

    @property
    def interrupted(self) -> bool:
        """Whether points are missing because the run was interrupted."""
        both = (self.longitudinal.status, self.lateral.status)
        return any((status == RowStatus.UNFINISHED).any() for status in both)

    def _readable_title(self) -> str:
        return f": {plural(self.longitudinal.load.size + self.lateral.load.size, 'point')}"

    def _readable_rows(self) -> Mapping[str, Row]:
        stiffness = ", ".join(f"{value:.4g}" for value in self.cornering_stiffness[:, 0, 0])
        return {"cornering stiffness [N/rad]": stiffness}

    def parameters(self) -> list[dict[str, float]]:
        """One entry for every load, inclination and speed; keys name units, such as [N/rad]."""
        found = []
        for index in np.ndindex(self.cornering_stiffness.shape):
            load, lean, speed = index
            entry = {
                "load_N": self.sweep.loads[load], "inclination_deg": math.degrees(self.sweep.inclinations[lean]),
                "speed_mps": self.sweep.speeds[speed], "cornering_stiffness_N_per_rad": self.cornering_stiffness[index],
                "slip_stiffness_N": self.slip_stiffness[index],
                "aligning_stiffness_Nm_per_rad": self.aligning_stiffness[index], "trail_m": self.trail[index],
                "peak_driving": self.peak_driving[index], "peak_braking": self.peak_braking[index],
                "peak_left": self.peak_left[index], "peak_right": self.peak_right[index],
                "peak_driving_slip": self.peak_slip[(*index, 0)], "peak_braking_slip": self.peak_slip[(*index, 1)],
                "peak_left_angle_deg": math.degrees(self.peak_angle[(*index, 0)]),
                "peak_right_angle_deg": math.degrees(self.peak_angle[(*index, 1)]),
                "load_sensitivity_x_per_kN": 1e3 * self.load_sensitivity[0, lean, speed],
                "load_sensitivity_y_per_kN": 1e3 * self.load_sensitivity[1, lean, speed],
            }  # fmt: skip
            found.append({key: float(value) for key, value in entry.items()})
        return found


def run_tire_rig(
    tire: Tire, sweep: TireSweep, *, device: str = "cpu", progress: Progress | None = None
) -> TireCurves:  # fmt: skip
    """Curves and characteristic values of a tire, all points in one batch.

    An interruption leaves what has settled.

    Args:
        tire: its description, of a template that makes forces of its own.
        sweep: what to go through.
        device: that evaluates the kernel.
        progress: is called with the share that is done.

    Raises:
        SpecError: a range is empty, or the tire makes no forces of its own.
    """
    sweep.check()
    loads, leans, speeds = (np.array(v) for v in (sweep.loads, sweep.inclinations, sweep.speeds))
    slips = np.linspace(-sweep.slip, sweep.slip, sweep.points)
    angles = np.linspace(-sweep.angle, sweep.angle, sweep.points)
    small = np.array([-SMALL_SLIP, SMALL_SLIP])
    aside = np.array([0.0, *sweep.combined_angles])
    grid = (loads[:, None, None, None], leans[:, None, None], speeds[:, None])
    wide_slips = np.linspace(-1.0, 1.0, WIDE_POINTS) * max(WIDE_SLIP, sweep.slip)
    wide_angles = np.linspace(-1.0, 1.0, WIDE_POINTS) * max(WIDE_ANGLE, sweep.angle)
    none = np.zeros(1)
    pieces = [(slips, a) for a in aside] + [(none, angles), (small, 0.0), (none, small)]
    pieces += [(wide_slips, 0.0), (none, wide_angles)]
    batches = [np.broadcast_arrays(s, a, *grid) for s, a in pieces]
    slip, angle, load, lean, speed = (np.concatenate([np.ravel(b[k]) for b in batches]) for k in range(5))
    found = tire_forces(
        tire, slip_ratio=slip, slip_angle=angle, inclination=lean, load=load, speed=speed, friction=sweep.friction,
        device=device, progress=progress,
    )  # fmt: skip
    ends = np.cumsum([0, *(b[0].size for b in batches)])
    cut = [found[ends[k] : ends[k + 1]].reshaped(b[0].shape) for k, b in enumerate(batches)]
    across = cut[len(aside)]
    along = found[: ends[len(aside)]].reshaped((len(aside), *cut[0].load.shape))
    return _characterised(sweep, along, across, (cut[-4], cut[-3]), (cut[-2], cut[-1]))


def _characterised(
    sweep: TireSweep, along: TireForces, across: TireForces, small: tuple[TireForces, TireForces],
    wide: tuple[TireForces, TireForces],
) -> TireCurves:  # fmt: skip
    """Stiffnesses from small slips and slip angles, peaks from wide ones."""
    small_slip, small_angle = small
    slip_stiffness = (small_slip.fx[..., 1] - small_slip.fx[..., 0]) / (2.0 * SMALL_SLIP)
    cornering = -(small_angle.fy[..., 1] - small_angle.fy[..., 0]) / (2.0 * SMALL_SLIP)
    aligning = (small_angle.mz[..., 1] - small_angle.mz[..., 0]) / (2.0 * SMALL_SLIP)
    straight, turned = wide
    driving, driving_slip = _peak(straight.fx / straight.load, straight.slip_ratio)
    braking, braking_slip = _peak(-straight.fx / straight.load, straight.slip_ratio)
    left, left_angle = _peak(turned.fy / turned.load, turned.slip_angle)
    right, right_angle = _peak(-turned.fy / turned.load, turned.slip_angle)
    means = np.stack([0.5 * (driving + braking), 0.5 * (left + right)])
    return TireCurves(
        sweep, along, across, slip_stiffness, cornering, aligning, np.divide(aligning, cornering), driving, braking,
        left, right, np.stack([driving_slip, braking_slip], -1), np.stack([left_angle, right_angle], -1),
        _slope(np.array(sweep.loads), means),
    )  # fmt: skip


def _peak(values: Array, abscissae: Array) -> tuple[Array, Array]:
    """Largest values along the last axis and where they are; NaN where no point is done."""
    filled = np.where(np.isfinite(values), values, -np.inf)
    best = filled.argmax(axis=-1)[..., None]
    peak = np.take_along_axis(filled, best, -1)[..., 0]
    where = np.take_along_axis(abscissae, best, -1)[..., 0]
    return np.where(np.isfinite(peak), peak, np.nan), np.where(np.isfinite(peak), where, np.nan)


def _slope(loads: Array, peaks: Array) -> Array:
    """(2, C, S) slopes of (2, L, C, S) over the loads by least squares; NaN for one load."""
    away = loads - loads.mean()
    size = float(away @ away)
    if size == 0.0:
        return np.full((2, *peaks.shape[2:]), np.nan)
    return np.einsum("l,klcs->kcs", away, peaks) / size
