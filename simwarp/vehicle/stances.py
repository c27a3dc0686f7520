"""How a vehicle stands: heights, angles, springs and stops, and the forces with which its wheels push sideways.

Two states are looked at. Standing, every wheel is on a plate that slides and turns freely, as on a bench for wheel
alignment: with friction, tires would keep whatever side force the way down left them, in one of many states. Rolling,
the vehicle coasts straight on, without its driveline: tires then have the side forces of their toe and camber.
"""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np

from simwarp.core.object_repr import Readable, plural
from simwarp.core.rotation import matrix_of, rotate
from simwarp.core.types import Material, ModelError, pose
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.parts import ForceLine, SpecError
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.suspensions.alignment import elastic, free_length, tierod_length
from simwarp.vehicle.suspensions.corner import spring_force
from simwarp.vehicle.suspensions.line_lengths import line_lengths
from simwarp.vehicle.suspensions.wheel_axes import camber_angles, toe_angles
from simwarp.vehicle.tires.parameter_vector_kernels import Common
from simwarp.vehicle.tires.tires import Tires
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

STEP: Final = 1.0e-3
"""Of the simulations [s]."""
SETTLING_STEPS: Final = 200
"""Of motion behind the static solver: what it found has to stay."""
ROLLING_TIME: Final = 4.0
"""Until a rolling vehicle is looked at [s]."""
ROLLING_SPEED: Final = 5.0
"""At which it starts to roll [m/s]."""
SLIPPERY: Final = 1.0e-6
"""Friction of the plates under standing wheels."""
ROAD: Final = 0.9
"""Friction of the road under rolling ones."""
HYDRAULIC_COLUMNS: Final = 4
"""Lengths of the map of a damper with a hydraulic stop at either end of its stroke."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LineStance:
    """A spring, a damper or both of a left wheel."""

    length: float
    """[m]"""
    free_length: float | None
    """Of a spring [m]; None of a damper alone."""
    force: float
    """That pushes its ends apart [N]; of springs and stops, for dampers are still."""
    stop: str
    """That it has run into: "bump", "rebound", "hydraulic bump", "hydraulic rebound"; empty: none."""
    into_stop: float
    """How far [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class AxleStance:
    """An axle; means of its two wheels."""

    ride_height: float
    """Of the frame of reference above the ground, over the wheels as built [m]; trailers' axles have the trailer's."""
    travel: float
    """Of the wheels' centres upwards from where they are built, in that frame [m]."""
    toe: float
    """Positive where the wheels' fronts point inwards [rad]."""
    camber: float
    """Positive where their tops lean outwards [rad]."""
    track: float
    """Between the wheels' centres [m]."""
    load: float
    """On each wheel [N]."""
    side_force: float
    """Of the ground on each wheel, positive inwards [N]."""
    tierod: float | None
    """Length of each tie rod [m]; None: the axle has none."""
    lines: tuple[LineStance, ...]
    """Springs and dampers of the left side, in the order of the description."""


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class Stance(Readable):
    """A whole vehicle."""

    height: float
    """Of the frame of reference's origin above the ground [m]."""
    pitch: float
    """Positive nose down [rad]."""
    wheelbase: float
    """Between the centres of the first and the last axle, level, without those of trailers [m]."""
    com_height: float
    """Of the centre of mass of the whole vehicle above the ground [m]."""
    axles: tuple[AxleStance, ...]
    """Those of trailers come last."""

    def _readable_title(self) -> str:
        return f": {plural(len(self.axles), 'axle')}, {self.height:.4f} m above the ground"


def stance(spec: VehicleSpec, *, speed: float = 0.0, device: str = "cpu") -> Stance:
    """Let a vehicle settle on level ground, and read how it stands or rolls.

    Args:
        spec: the vehicle.
        speed: forwards [m/s]. 0: it stands, every wheel on a plate that slides freely, found by the static solver. Else
            it coasts straight on from this speed, without its driveline, for four seconds.
        device: device of the simulation.

    Raises:
        SpecError: the speed is negative or not finite; the vehicle does not come to rest, as on tires that need soil.
        ModelError: its tires are flexible: their meshes have no static solver.
    """
    spec.require_linkages("its stance")
    if not 0.0 <= speed < np.inf:
        raise SpecError(f"speed: must be >= 0 m/s and finite, got {speed:g}")
    coasting = dataclasses.replace(spec, driveline=None, engine=None, transmission=None)
    builder = ModelBuilder()
    parts = add_vehicle(builder, coasting, speed=speed)
    friction = ROAD if speed else SLIPPERY
    if any(side.meets_shapes for side in parts.sides):
        builder.add_shape_plane(material=Material(friction=friction))
    model = builder.finalize(1, device, per_world=per_world())
    vehicle = Vehicle(parts, model)
    vehicle.tires.ground_friction.fill_(friction)
    simulation = Simulation(model, STEP, elements=[vehicle], solver=VEHICLE_SOLVER)
    if speed:
        simulation.step(round(ROLLING_TIME / STEP))
    else:
        _stand(spec, simulation, vehicle)
    if not np.isfinite(simulation.state.body_x.numpy()).all():
        raise SpecError(f"{spec.name}: it must come to rest, but a value is not finite; check its springs and masses")
    return _read(simulation, vehicle)


def _stand(spec: VehicleSpec, simulation: Simulation, vehicle: Vehicle) -> None:
    """The equilibrium on plates, with the brakes on."""
    from simwarp.analysis.statics import solve_static  # it loads SciPy, which vehicles do without

    if isinstance(vehicle.tires, Tires):
        parameters = vehicle.tires.parameter.numpy()
        parameters[:, :, [Common.FRICTION_LOWER, Common.FRICTION_UPPER]] = (0.0, SLIPPERY)
        vehicle.tires.parameter.assign(parameters)
    inputs = vehicle.input.numpy()
    inputs[:, 2] = 1.0
    vehicle.input.assign(inputs)
    try:
        solve_static(simulation)
    except ModelError as error:
        raise SpecError(f"{spec.name}: it does not come to rest on level ground: {error}") from None
    simulation.step(SETTLING_STEPS)


def _read(simulation: Simulation, vehicle: Vehicle) -> Stance:
    parts, state = vehicle.parts, simulation.state
    places = np.asarray(state.body_x.numpy()[0], np.float64)
    rotations = state.body_rot.numpy()[0]
    turn = matrix_of(rotations[parts.chassis])
    forward = turn[:, 0] * (1.0, 1.0, 0.0)
    forward /= np.linalg.norm(forward)
    left = np.cross((0.0, 0.0, 1.0), forward)
    level = np.array([forward, left, (0.0, 0.0, 1.0)])
    forces, loads = vehicle.tires.force_w.numpy()[0], vehicle.tires.load.numpy()[0]
    masses = np.array([simulation.model.builder.bodies[body].mass for body in parts.bodies])
    com_height = float(masses @ places[list(parts.bodies), 2] / masses.sum())
    axles, middles, axles_as_built = [], [], parts.spec.all_axles
    for first in range(0, len(parts.sides), 2):
        pair = parts.sides[first : first + 2]
        unit = parts.unit_of(pair[0].axle)
        axle = axles_as_built[pair[0].axle]
        shift = parts.spec.units[parts.units.index(unit)].origin
        turn = matrix_of(rotations[unit.chassis])
        origin = places[unit.chassis] + turn @ unit.reference
        built = np.subtract(np.add(axle.location, axle.suspension.spindle.com), shift)
        centers = np.array([places[side.spindle] for side in pair])
        middles.append(centers.mean(axis=0))
        center = np.mean([turn.T @ (places[side.spindle] - origin) for side in pair], axis=0)
        axes = np.array([matrix_of(rotations[side.spindle])[:, 1] for side in pair]) @ level.T
        signs = np.array([side.side for side in pair])
        pushes = [-side.side * (forces[first + k] @ left) for k, side in enumerate(pair)]
        springs: tuple[ForceLine, ...] = getattr(axle.suspension, "springs", ())
        held = simulation.model.builder.bodies[unit.chassis].pose
        offset = unit.reference + np.subtract(axle.location, shift)
        frame = pose(held.position + rotate(held.rotation, offset), held.rotation)
        name = pair[0].name.rpartition(".")[0]
        lengths = line_lengths(simulation, axle.suspension, name, unit.chassis, frame)
        above = origin + turn @ (built[0], 0.0, 0.0)
        axles.append(
            AxleStance(
                ride_height=float(above[2]), travel=float(center[2] - built[2]),
                toe=float(toe_angles(axes, signs).mean()), camber=float(camber_angles(axes, signs).mean()),
                track=abs(float((centers[0] - centers[-1]) @ left)), load=float(loads[first : first + 2].mean()),
                side_force=float(np.mean(pushes)), tierod=tierod_length(axle.suspension),
                lines=tuple(_line(line, length) for line, length in zip(springs, lengths[0].tolist(), strict=True)),
            )
        )  # fmt: skip
    turn = matrix_of(rotations[parts.chassis])
    origin = places[parts.chassis] + turn @ parts.reference
    pitch = float(np.arcsin(np.clip(-turn[2, 0], -1.0, 1.0)))
    rear = middles[len(parts.spec.axles) - 1]
    return Stance(
        height=float(origin[2]), pitch=pitch, wheelbase=float((middles[0] - rear) @ forward),
        com_height=com_height, axles=tuple(axles),
    )  # fmt: skip


def _line(line: ForceLine, length: float) -> LineStance:
    stop, into = stop_at(line, length)
    force = float(spring_force(line, np.array(length)))
    return LineStance(length=length, free_length=free_length(line), force=force, stop=stop, into_stop=into)


def stop_at(line: ForceLine, length: float) -> tuple[str, float]:
    """The stop that a line has run into at a length, and how far [m]; empty and 0 between its stops."""
    if line.bump_curve is not None:
        if line.min_length is not None and length < line.min_length:
            return "bump", line.min_length - length
        if line.max_length is not None and length > line.max_length:
            return "rebound", length - line.max_length
    if line.damper_map is not None and len(line.damper_map[0]) >= HYDRAULIC_COLUMNS:
        lengths = line.damper_map[0]
        if length < lengths[1]:
            return "hydraulic bump", lengths[1] - length
        if length > lengths[-2]:
            return "hydraulic rebound", length - lengths[-2]
    return "", 0.0


def sprung(spec: VehicleSpec, axle: int) -> bool:
    """Whether an axle has springs; dampers alone are none."""
    return any(elastic(line) for line in getattr(spec.all_axles[axle].suspension, "springs", ()))
