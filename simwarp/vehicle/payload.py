"""Loads on a vehicle: a body fixed to the chassis, whose mass and place may differ in every world.

Mass, inertia and centre of mass of the vehicle change with it, while the chassis keeps its own centre of mass, on which
hardpoints, drivers and records are based.

    load = add_payload(builder, parts, mass=100.0)
    model = builder.finalize(worlds, per_world=per_world(PAYLOAD))
    ...
    set_payload(simulation, load, mass=masses, position=positions)
"""

from __future__ import annotations

import dataclasses
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import rotate
from simwarp.core.types import ModelError, Vec3, finite_vector, formatted, host_values, pose
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.simulation.world_masks import mask_of_worlds
from simwarp.vehicle.construction import VehicleParts
from simwarp.vehicle.spec.vehicle_spec import SpecError

PAYLOAD: Final = ("body_mass", "body_inertia_b", "joint_anchor0")
"""Model arrays that a load writes: `finalize(per_world=per_world(PAYLOAD))`."""

SIZE: Final = (1.0, 1.0, 0.5)
"""Of the box that a load's inertia is that of, where none is given [m]."""


@dataclasses.dataclass(frozen=True)
class Payload:
    """A load: indices of its body, of the joint that holds it and of the chassis."""

    body: int
    joint: int
    chassis: int
    reference: npt.NDArray[np.float64]
    """(3,) origin of the vehicle's frame of reference from the chassis' centre of mass, body axes [m]."""
    size: Vec3
    """Of the box whose inertia it has [m]."""


def box_inertia(mass: npt.ArrayLike, size: Vec3) -> npt.NDArray[np.float64]:
    """(..., 3, 3) of boxes of masses [kg] and one size [m] about their centres [kg·m²]."""
    x, y, z = (side * side / 12.0 for side in size)
    diagonal = np.diag([y + z, x + z, x + y])
    return np.asarray(mass, dtype=float)[..., None, None] * diagonal


def add_payload(
    builder: ModelBuilder, parts: VehicleParts, *, mass: float, position: Vec3 = (0.0, 0.0, 0.5), size: Vec3 = SIZE,
    name: str | None = None,
) -> Payload:  # fmt: skip
    """Fixes a box to a vehicle's chassis; call it after `add_vehicle`.

    Args:
        mass: [kg], above 0.
        position: of its centre in the vehicle's frame of reference [m].
        size: of the box that its inertia is that of [m].
        name: of the body; `payload` behind the vehicle's prefix when None.

    Raises:
        SpecError: a length of `size` is negative, or more than one is 0.
        ModelError: another value is not usable, or the name is taken.
    """
    name = f"{parts.prefix}payload" if name is None else name
    if not all(side >= 0.0 for side in finite_vector(name, "size", size, 3)) or not np.count_nonzero(size) > 1:
        raise SpecError(f"size: must be three lengths that are not negative, one of them 0 at most, got {size!r}")
    chassis = builder.bodies[parts.chassis]
    offset = parts.reference + finite_vector(name, "position", position, 3)
    place = pose(chassis.pose.position + rotate(chassis.pose.rotation, offset), chassis.pose.rotation)
    body = builder.add_body(
        name, mass=mass, inertia=box_inertia(mass, size), pose=place, velocity=tuple(chassis.velocity),
        omega=tuple(chassis.omega),
    )  # fmt: skip
    joint = builder.add_joint_fixed(f"{name}.hold", parts.chassis, body)
    return Payload(body, joint, parts.chassis, parts.reference, size)


def set_payload(
    simulation: Simulation, payload: Payload, *, mass: npt.ArrayLike | None = None,
    position: npt.ArrayLike | None = None, worlds: Any = None,
) -> None:  # fmt: skip
    """Gives worlds other loads, and moves the load's body to where it belongs. Copies through the host: for starts, not
    for every step. `Simulation.reset` puts the body back where it was built: call this again after it, without mass
    and position, for the same worlds.

    Args:
        simulation: of a model whose `PAYLOAD` arrays are each world's own.
        payload: of `add_payload`.
        mass: (W,) or one [kg], above 0; as it is when None.
        position: (W, 3) or (3,) of its centre in the vehicle's frame of reference [m]; as it is when None.
        worlds: (W,) bool; all when None.

    Raises:
        ModelError: the model's worlds share an array, or a value cannot be used.
    """
    count = simulation.model.world_count
    arrays = {name: getattr(simulation.model, name) for name in PAYLOAD}
    shared = [name for name, array in arrays.items() if array.shape[0] != count]
    if shared:
        raise ModelError(f"set_payload: every world needs its own {', '.join(shared)}; name them in per_world")
    mask = np.full(count, True)
    if worlds is not None:
        mask = mask_of_worlds("set_payload", worlds, simulation.model, name="worlds").numpy()
    values = {name: array.numpy().copy() for name, array in arrays.items()}
    if mass is not None:
        kilograms = _per_world("mass", mass, (count,))
        if not (np.isfinite(kilograms) & (kilograms > 0.0)).all():
            raise ModelError(f"set_payload: mass must be positive [kg], got {formatted(mass)}; leave it out to keep it")
        values["body_mass"][mask, payload.body] = kilograms[mask]
        values["body_inertia_b"][mask, payload.body] = box_inertia(kilograms[mask], payload.size)
    if position is not None:
        place = _per_world("position", position, (count, 3))
        if not np.isfinite(place).all():
            raise ModelError(
                f"set_payload: position must be finite [m], got {formatted(position)}; leave it out to keep it"
            )
        values["joint_anchor0"][mask, payload.joint] = payload.reference + place[mask]
    for name, array in arrays.items():
        array.assign(values[name])
    _put_in_place(simulation, payload, mask, values["joint_anchor0"][:, payload.joint])
    simulation.measure(mask)


def _per_world(name: str, value: Any, shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    """One value for all worlds, or one for each."""
    try:
        return np.broadcast_to(np.asarray(host_values(value), dtype=np.float64), shape)
    except (TypeError, ValueError):
        one = "three numbers" if len(shape) > 1 else "one"
        rule = f"{one}, or {one} for each of {shape[0]} worlds"
        raise ModelError(f"set_payload: {name} must be {rule}, got {formatted(value)}; match the worlds") from None


def _put_in_place(
    simulation: Simulation, payload: Payload, mask: npt.NDArray[np.bool_], offset: npt.NDArray[np.float64]
) -> None:
    """The load's body moves with the chassis, `offset` (W, 3) from its centre of mass in its axes."""
    state = simulation.state
    rotation, omega = state.body_rot.numpy().copy(), state.body_omega.numpy().copy()
    x, v = state.body_x.numpy().copy(), state.body_v.numpy().copy()
    for world in np.nonzero(mask)[0]:
        arm = rotate(rotation[world, payload.chassis], offset[world])
        x[world, payload.body] = x[world, payload.chassis] + arm
        rotation[world, payload.body] = rotation[world, payload.chassis]
        v[world, payload.body] = v[world, payload.chassis] + np.cross(omega[world, payload.chassis], arm)
        omega[world, payload.body] = omega[world, payload.chassis]
    for array, values in (
        (state.body_x, x), (state.body_rot, rotation), (state.body_v, v), (state.body_omega, omega),
    ):  # fmt: skip
        array.assign(values)
