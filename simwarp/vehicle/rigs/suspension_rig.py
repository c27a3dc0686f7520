"""Kinematics of an axle on its bench: angles, axes and levers of its wheels over travel and steering, and what its
springs make of them. Every point of a sweep is a world; so are the neighbours between which rates are measured.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np

from simwarp.vehicle.rigs.rig_rows import Progress
from simwarp.vehicle.rigs.standing_loads import StandingLoads, standing_loads
from simwarp.vehicle.rigs.suspension_bench import BenchMaker
from simwarp.vehicle.rigs.suspension_curves import (
    SuspensionCurve,
    SuspensionMotion,
    SuspensionReference,
    SuspensionRun,
)
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.vehicle_spec import Axle, PinnedAxle, RigidSuspension, VehicleSpec

TRAVEL: Final = 0.17
"""Usual travel, as a share of the tire's radius."""
SEARCH: Final = 0.35
"""Travel in which the standing state is looked for, as a share of the tire's radius."""
SEARCH_POINTS: Final = 29


def run_suspension_rig(
    spec: VehicleSpec, axle: int = 0, *, travel: float | None = None, points: int = 41,
    reference: SuspensionReference = SuspensionReference.STANDING, loaded_radius: float | None = None,
    device: str = "cpu", progress: Progress | None = None,
) -> SuspensionRun:  # fmt: skip
    """Kinematics of an axle in parallel and opposite travel and over the steering, each motion a batch of worlds.

    An interruption leaves the motions that are done.

    Args:
        spec: the vehicle.
        axle: index, from the front.
        travel: largest travel up and down [m]; None: 17 % of the tire's radius.
        points: of a motion, an odd number: the middle one is the state of reference.
        reference: state from which travel counts.
        loaded_radius: of the tires, from the wheels' centres down to the ground [m]; None: the one under the standing
            vehicle.
        device: that closes the linkages.
        progress: is called with the share that is done.

    Raises:
        SpecError: no such axle, or one without springs; an empty range.
    """
    part = checked_axle(spec, axle)
    reach = TRAVEL * part.tire.radius if travel is None else travel
    if not (math.isfinite(reach) and reach > 0.0):
        raise SpecError(f"travel: must be > 0 m, got {reach:g}: the range would be empty")
    if points < 3 or points % 2 == 0:
        raise SpecError(f"points: must be an odd number from 3 on, got {points}: the middle one is the reference")
    state = reference_state(spec, axle, reference, loaded_radius=loaded_radius, device=device)
    motions = [SuspensionMotion.OPPOSITE]
    if not isinstance(part.suspension, PinnedAxle):
        motions.insert(0, SuspensionMotion.PARALLEL)
    if part.steering is not None:
        motions.append(SuspensionMotion.STEERING)
    bench_of = BenchMaker(spec, axle, state.loaded_radius, state.loads, device)
    curves: dict[SuspensionMotion, SuspensionCurve] = {}
    interrupted = False
    try:
        for number, motion in enumerate(motions):
            bench = bench_of(motion, state.travel + np.linspace(-reach, reach, points))
            curves[motion] = bench.curve()
            if progress is not None:
                progress((number + 1) / len(motions))
    except KeyboardInterrupt:
        if not curves:
            raise
        interrupted = True
    return SuspensionRun(axle, curves, state.loads, state.travel, interrupted)


@dataclasses.dataclass(frozen=True)
class ReferenceState:
    """A state from which travel counts.

    Attributes:
        travel: of the wheels' centres from the state as built [m].
        loaded_radius: of the axle's tires [m].
        loads: of the standing vehicle.
    """

    travel: float
    loaded_radius: float
    loads: StandingLoads


def reference_state(
    spec: VehicleSpec, axle: int, reference: SuspensionReference, *, loaded_radius: float | None = None,
    device: str = "cpu",
) -> ReferenceState:  # fmt: skip
    """The state of reference of an axle that travels.

    Args:
        spec: the vehicle.
        axle: index, from the front.
        reference: which state is meant.
        loaded_radius: of its tires [m]; None: the one under the standing vehicle.
        device: that closes the linkages.

    Raises:
        SpecError: no such axle, or one without springs.
    """
    part = checked_axle(spec, axle)
    if isinstance(part.suspension, RigidSuspension):
        raise SpecError(
            f"axle {axle}: must have a suspension that travels, got '{part.suspension.template}'; take another axle"
        )
    if loaded_radius is not None and not 0.0 < loaded_radius <= part.tire.radius:
        raise SpecError(
            f"loaded_radius: must be above 0 and at most the tire's radius of {part.tire.radius:.4g} m, got "
            f"{loaded_radius:g}"
        )
    loads = standing_loads(spec, device=device)
    radius = float(loads.loaded_radius[axle]) if loaded_radius is None else loaded_radius
    standing = reference is SuspensionReference.STANDING and bool(getattr(part.suspension, "springs", ()))
    travel = _standing_travel(BenchMaker(spec, axle, radius, loads, device)) if standing else 0.0
    return ReferenceState(travel, radius, loads)


def _standing_travel(bench_of: BenchMaker) -> float:
    """Travel from the state as built at which the wheels bear the standing vehicle [m].

    Raises:
        SpecError: the springs bear it nowhere near.
    """
    loads, axle = bench_of.loads, bench_of.axle
    reach, middle = SEARCH * bench_of.spec.all_axles[axle].tire.radius, 0.0
    for _ in range(2):  # in a wide range, and between two of its points
        curve = bench_of(SuspensionMotion.PARALLEL, middle + np.linspace(-reach, reach, SEARCH_POINTS)).curve()
        travel = middle + np.linspace(-reach, reach, SEARCH_POINTS)
        missing = curve.wheel_load.mean(axis=1) - loads.wheel_load[axle]
        done = np.flatnonzero(np.isfinite(missing))
        across = [k for k in done[:-1] if np.isfinite(missing[k + 1]) and missing[k] <= 0.0 < missing[k + 1]]
        if not across:
            raise SpecError(
                f"axle {axle}: its springs must bear {loads.wheel_load[axle]:.4g} N per wheel within {reach:.3g} m of "
                "the state as built, and do not; count travel from the state as built"
            )
        low = across[0]
        middle = float(travel[low] - missing[low] * (travel[low + 1] - travel[low]) / (missing[low + 1] - missing[low]))
        reach = float(travel[1] - travel[0])
    return middle


def checked_axle(spec: VehicleSpec, axle: int) -> Axle:
    """The axle of an index.

    Raises:
        SpecError: there is none.
    """
    axles = spec.all_axles
    if not 0 <= axle < len(axles):
        raise SpecError(f"axle: must be from 0 (front) to {len(axles) - 1} of '{spec.name}', got {axle}")
    return axles[axle]
