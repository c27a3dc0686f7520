"""Kinematics of an axle on a bench: angles of its wheels over their travel and the steering, in one batch.

The vehicle's frame of reference is held; every world gets a travel of both wheels and a steering of its own, and its
linkage is closed there. No force plays a part: springs, bushings' hinges aside, and anti-roll bars change nothing.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Final, cast

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.rotation import matrix_of
from simwarp.core.types import WORLD, WorldStatus, pose
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.spec.vehicle_spec import Axle, PinnedAxle, RigidSuspension, SpecError, VehicleSpec
from simwarp.vehicle.suspensions import Side, add_antiroll_bar, add_axle
from simwarp.vehicle.suspensions.corner import Array, Frame
from simwarp.vehicle.suspensions.line_lengths import line_lengths
from simwarp.vehicle.suspensions.open_joints import open_joints
from simwarp.vehicle.suspensions.steerings import SteeringParts, add_steering
from simwarp.vehicle.suspensions.wheel_axes import camber_angles, steer_angles, toe_angles

FRAME: Final = "axle"
"""Name of the axle's frame on the bench."""
STAGE: Final = 0.01
"""The travel is approached in steps of at most this [m], so that Newton's method stays on its branch."""
FEWEST_STAGES: Final = 8
"""The same for the steering, in parts of what is asked for."""


@dataclasses.dataclass(frozen=True)
class TravelTable:
    """Angles of an axle's wheels; n states, columns left and right. NaN where the linkage does not reach."""

    steering: Array
    """(n,) -1 to 1, positive to the left."""
    travel: Array
    """(n, 2) of the wheels' centres upwards, from the state as built [m]."""
    steer: Array
    """(n, 2) heading of the wheels, positive to the left [rad]."""
    toe: Array
    """(n, 2) the same, positive where the wheel's front points inwards [rad]."""
    camber: Array
    """(n, 2) positive where the wheel's top leans outwards [rad]."""
    center: Array
    """(n, 2, 3) of the wheels, in the vehicle's frame of reference [m]."""
    axis: Array
    """(n, 2, 3) of the wheels, likewise, unit vectors to the left."""
    reached: npt.NDArray[np.bool_]
    """(n,) whether the linkage closes there."""
    reason: npt.NDArray[np.object_]
    """(n,) why it does not: text, empty where it does."""


@dataclasses.dataclass(frozen=True)
class Bench:
    """Indices of what holds an axle on its bench."""

    sides: tuple[Side, Side]
    planes: tuple[int, ...]
    """Joints that hold the height of the left and the right wheel."""
    steering: SteeringParts | None
    bar: int | None
    """Joint that twists the anti-roll bar."""


@dataclasses.dataclass(frozen=True)
class HeldAxle:
    """An axle on its bench, its linkage closed at n states."""

    simulation: Simulation
    bench: Bench
    steering: Array
    """(n,) -1 to 1."""
    rest: Array
    """(n, 2, 3) centres of the wheels as built [m]."""
    reached: npt.NDArray[np.bool_]
    """(n,) whether the linkage closes there."""
    reason: npt.NDArray[np.object_]
    """(n,) why it does not: the joint that stays apart and where on the way; empty where it closes."""


def travel_table(
    spec: VehicleSpec, axle: int, travels: npt.ArrayLike, steering: npt.ArrayLike = 0.0, *,
    right: npt.ArrayLike | None = None, device: str = "cpu",
) -> TravelTable:  # fmt: skip
    """Wheel angles of an axle over travel and steering, which broadcast against each other to n states.

    Args:
        spec: the vehicle.
        axle: index, from the front.
        travels: (n,) or one, of the left wheel's centre upwards [m].
        steering: (n,) or one, -1 to 1, positive to the left; without effect on an axle that is not steered.
        right: (n,) or one, travels of the right wheel [m]; those of the left one when None. On a pinned axle it follows
            by itself.

    Returns:
        Arrays over the n states, those of the wheels (n, 2): columns left and right.

    Raises:
        SpecError: no such axle, or a travel other than 0 of rigid wheels.
    """
    other = travels if right is None else right
    return wheel_angles(hold_axle(spec, axle, travels, other, steering, device=device))


def spring_lengths(spec: VehicleSpec, axle: int, travels: npt.ArrayLike, *, device: str = "cpu") -> Array:
    """Lengths of an axle's springs and dampers over travel, both wheels alike.

    Args:
        spec: the vehicle.
        axle: index, from the front.
        travels: (n,) of the wheels' centres upwards [m].
        device: device of the batch.

    Returns:
        (n, k) of the lines of the left side, in the order of the description [m]; NaN where the linkage does not reach.

    Raises:
        SpecError: no such axle, or a travel other than 0 of rigid wheels.
    """
    held = hold_axle(spec, axle, travels, travels, device=device)
    part = spec.all_axles[axle]
    found = line_lengths(held.simulation, part.suspension, FRAME, WORLD, pose(part.location))
    found[~held.reached] = np.nan
    return found


def hold_axle(
    spec: VehicleSpec, axle: int, left: npt.ArrayLike, right: npt.ArrayLike, steering: npt.ArrayLike = 0.0, *,
    device: str = "cpu",
) -> HeldAxle:  # fmt: skip
    """Closes the linkage of an axle at n states, as `travel_table` does, for whoever measures more of it.

    Raises:
        SpecError: no such axle, or a travel other than 0 of rigid wheels.
    """
    spec.require_linkages("the bench of its axles")
    count = len(spec.all_axles)
    if not 0 <= axle < count:
        raise SpecError(f"axle: must be in 0..{count - 1}, got {axle!r}")
    lefts, rights, inputs = (np.ravel(v) for v in np.broadcast_arrays(*map(_floats, (left, right, steering))))
    part = spec.all_axles[axle]
    if isinstance(part.suspension, RigidSuspension) and (np.any(lefts) or np.any(rights)):
        raise SpecError(f"travels: must be 0 for the template '{part.suspension.template}', which has no springs")
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    bench = _build(builder, spec, part)
    heights = np.stack([lefts, rights], axis=1)
    model = builder.finalize(len(lefts), device, per_world=["joint_anchor0"] if bench.planes else [])
    simulation = Simulation(model, 1.0e-3)
    rest = simulation.state.body_x.numpy()[:, [side.spindle for side in bench.sides]]
    held = cast(wp.array, model.parameters.joint_anchor0)
    anchors = held.numpy().copy()
    stages = max(FEWEST_STAGES, math.ceil(float(np.abs(heights).max()) / STAGE))
    reached, reason = np.full(len(lefts), True), np.full(len(lefts), "", dtype=object)
    for stage in range(1, stages + 1):
        share = stage / stages
        for column, joint in enumerate(bench.planes):
            anchors[:, joint, 2] = rest[:, column, 2] + share * heights[:, column]
        held.assign(anchors)
        q = simulation.state.joint_q.numpy().copy()
        if bench.steering is not None:
            q[:, model.joint_dof_start[bench.steering.joint]] = share * inputs * bench.steering.travel
        simulation.set_joint_state(None, q, None)
        lost = reached & ((simulation.state.world_status.numpy() & WorldStatus.NOT_ASSEMBLED) != 0)
        if lost.any():
            reached &= ~lost
            worlds = np.flatnonzero(lost)
            for world, phrase in zip(worlds, open_joints(model, simulation.state, worlds), strict=True):
                place = _place(share * heights[world], share * inputs[world] if bench.steering is not None else 0.0)
                reason[world] = f"the linkage does not close: {phrase} at {place}"
    return HeldAxle(simulation, bench, inputs, rest, reached, reason)


def _place(heights: Array, steering: float) -> str:
    """Travels of both wheels and the steering, for people."""
    text = f"{1e3 * heights[0]:.1f} and {1e3 * heights[1]:.1f} mm of travel from the state as built"
    return f"{text}, steering {steering:.2f}" if steering else text


def _floats(values: npt.ArrayLike) -> Array:
    return np.asarray(values, dtype=np.float64)


def _build(builder: ModelBuilder, spec: VehicleSpec, axle: Axle) -> Bench:
    """The axle, what steers it and its anti-roll bar on the world; planes hold the centres of wheels that can move."""
    link, steering = WORLD, None
    if axle.steering is not None:
        mount = spec.steerings[axle.steering]
        steering = add_steering(Frame(builder, "steering", pose(mount.location, mount.rotation)), mount.steering, WORLD)
        link = steering.link
    sides = add_axle(Frame(builder, FRAME, pose(axle.location)), 0, axle, WORLD, link)
    bar = None
    if axle.antiroll_bar is not None:
        middle = Frame(builder, "antiroll_bar", pose(axle.antiroll_bar.location))
        bar = add_antiroll_bar(middle, axle.antiroll_bar, WORLD, sides[0].bar, sides[1].bar)
    movable: tuple[Side, ...] = sides
    if isinstance(axle.suspension, RigidSuspension):
        movable = ()
    elif isinstance(axle.suspension, PinnedAxle):
        movable = sides[:1]
    planes = tuple(
        builder.add_joint_point_on_plane(
            f"{side.name}.height", WORLD, side.spindle, anchor=builder.bodies[side.spindle].pose.position,
            normal=(0.0, 0.0, 1.0),
        )
        for side in movable
    )  # fmt: skip
    return Bench(sides, planes, steering, bar)


def wheel_angles(held: HeldAxle) -> TravelTable:
    """Angles of the wheels' axes, which are y of the spindles, as the axle is now."""
    state, sides = held.simulation.state, held.bench.sides
    spindles = [side.spindle for side in sides]
    signs = np.array([side.side for side in sides])
    center = np.array(state.body_x.numpy()[:, spindles], dtype=np.float64)
    rotations = np.array(state.body_rot.numpy()[:, spindles], dtype=np.float64)
    axes = np.array([[matrix_of(q)[:, 1] for q in row] for row in rotations])
    axes[~held.reached] = center[~held.reached] = np.nan
    return TravelTable(
        steering=held.steering, travel=(center - held.rest)[..., 2], steer=steer_angles(axes),
        toe=toe_angles(axes, signs), camber=camber_angles(axes, signs), center=center, axis=axes, reached=held.reached,
        reason=held.reason,
    )  # fmt: skip
