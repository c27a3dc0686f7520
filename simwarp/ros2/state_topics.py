"""Topics of the state: transforms, odometry, joints and their commands, the wheels and the inputs of a vehicle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import warp as wp

from simwarp.model.joint_types import ELEMENTS
from simwarp.model.model import Model
from simwarp.ros2.frame_names import BASE, ODOM, Names
from simwarp.ros2.ros_messages import MessageTypes, Template
from simwarp.ros2.world_rows import row_of
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle, TrackedVehicle
from simwarp.vehicle.vehicle import Vehicle, Vehicles

POSE: Final = tuple(f"translation.{name}" for name in "xyz") + tuple(f"rotation.{name}" for name in "xyzw")
"""Of a transform: seven numbers."""
INPUTS: Final = ("steering", "throttle", "braking", "clutch")
"""Of a vehicle, -1..1 and 0..1."""


class StateTopic(NamedTuple):
    """A topic, its message, and what writes the present state into that."""

    topic: str
    kind: str
    template: Template
    fill: Callable[[], None]


def vehicles_of(simulation: Simulation) -> list[AnyVehicle]:
    """The vehicles among the force elements of a simulation."""
    found: list[AnyVehicle] = []
    for element in simulation.elements:
        if isinstance(element, (Vehicle, TrackedVehicle)):
            found.append(element)
        elif isinstance(element, Vehicles):
            found += element
    return found


def body_frames(model: Model, base: int, names: Names) -> list[str]:
    """Frames of all bodies: their names, and `base_link`."""
    return [BASE if body == base else names(name) for body, name in enumerate(model.body_names)]


def transforms(types: MessageTypes, edges: Sequence[tuple[str, str]]) -> Template:
    """A message of transforms from (parent, child) frames."""
    return types.template(
        "tf2_msgs/msg/TFMessage",
        {"transforms": [{"header": {"frame_id": parent}, "child_frame_id": child} for parent, child in edges]},
    )


def transform_paths(count: int) -> list[list[str]]:
    """Places of the seven numbers of each transform: translation, rotation xyzw."""
    return [[f"transforms[{index}].transform.{name}" for name in POSE] for index in range(count)]


def state_topics(
    types: MessageTypes, simulation: Simulation, world: int, frames: Sequence[str], base: int
) -> list[StateTopic]:
    """Topics of a world's state.

    Args:
        types: of the messages.
        simulation: whose state it is.
        world: that is recorded.
        frames: of the bodies.
        base: body of `base_link`.
    """
    found = []
    if frames:
        found += [_bodies(types, simulation, world, frames), _odometry(types, simulation, world, base)]
    found += _joints(types, simulation, world)
    vehicles = vehicles_of(simulation)
    for number, vehicle in enumerate(vehicles):
        prefix = "/vehicle" if len(vehicles) == 1 else f"/vehicle_{number}"
        found += _vehicle(types, simulation, vehicle, world, prefix)
    return found


def named_numbers(types: MessageTypes, names: Sequence[str], fields: Sequence[str]) -> Template:
    """A JointState with these fields."""
    values: Mapping[str, Any] = {field: np.zeros(len(names)) for field in fields}
    return types.template("sensor_msgs/msg/JointState", {"name": list(names), **values})


def _bodies(types: MessageTypes, simulation: Simulation, world: int, frames: Sequence[str]) -> StateTopic:
    state = simulation.state
    place, turn = row_of(state.body_x, world), row_of(state.body_rot, world)
    template = transforms(types, [(ODOM, frame) for frame in frames])
    cells = template.doubles(transform_paths(len(frames)))
    values = np.zeros((len(frames), 7))

    def fill() -> None:
        values[:, :3], values[:, 3:] = place(), turn()
        cells.write(values)

    return StateTopic("/tf", "tf2_msgs/msg/TFMessage", template, fill)


def _odometry(types: MessageTypes, simulation: Simulation, world: int, base: int) -> StateTopic:
    """Pose of the base in the world, and its motion in its own axes."""
    state = simulation.state
    place, turn = row_of(state.body_x, world), row_of(state.body_rot, world)
    motion = [
        (row_of(getattr(state, name), world), row_of(getattr(state, f"{name}_low"), world))
        for name in ("body_v", "body_omega")
    ]
    template = types.template("nav_msgs/msg/Odometry", {"header": {"frame_id": ODOM}, "child_frame_id": BASE})
    position = [f"pose.pose.position.{name}" for name in "xyz"]
    orientation = [f"pose.pose.orientation.{name}" for name in "xyzw"]
    twist = [f"twist.twist.{part}.{name}" for part in ("linear", "angular") for name in "xyz"]
    cells = template.doubles([[*position, *orientation, *twist]])

    def fill() -> None:
        # In numbers of Python: of so few of them, arrays would take several times as long
        rotation = turn()[base].tolist()
        axes, values = _axes(*rotation), [*place()[base].tolist(), *rotation]
        for high, low in motion:
            # what float32 rounding kept back belongs to it
            x, y, z = (much + rest for much, rest in zip(high()[base].tolist(), low()[base].tolist(), strict=True))
            values += [x * along[0] + y * along[1] + z * along[2] for along in axes]
        cells.write([values])

    return StateTopic("/odom", "nav_msgs/msg/Odometry", template, fill)


def _axes(x: float, y: float, z: float, w: float) -> tuple[tuple[float, float, float], ...]:
    """The axes of a unit quaternion."""
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)),
        (2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)),
        (2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)),
    )


def _joints(types: MessageTypes, simulation: Simulation, world: int) -> list[StateTopic]:
    """Joints of one coordinate; what acts on them, where no vehicle moves itself."""
    model = simulation.model
    chosen = [index for index, kind in enumerate(model.joint_types) if len(ELEMENTS[kind].dofs) == 1]
    if not chosen:
        return []
    columns = np.array([model.joint_dof_start[index] for index in chosen])
    names = [model.joint_names[index] for index in chosen]
    state, control = simulation.state, simulation.control
    sources = [("/joint_states", {"position": state.joint_x, "velocity": state.joint_qd})]
    if not vehicles_of(simulation):
        commands = {
            "position": control.joint_target_q, "velocity": control.joint_target_qd, "effort": control.joint_force
        }  # fmt: skip
        sources.append(("/joint_commands", commands))
    return [_numbers(types, topic, names, arrays, world, columns) for topic, arrays in sources]


def _numbers(
    types: MessageTypes, topic: str, names: Sequence[str], arrays: Mapping[str, wp.array], world: int, columns: Any
) -> StateTopic:
    """A JointState of columns of (W, ...) arrays."""
    template = named_numbers(types, names, [*arrays])
    parts = [(template.numbers(field), row_of(array, world)) for field, array in arrays.items()]

    def fill() -> None:
        for cells, row in parts:
            cells[...] = row()[columns]

    return StateTopic(topic, "sensor_msgs/msg/JointState", template, fill)


def _vehicle(
    types: MessageTypes, simulation: Simulation, vehicle: AnyVehicle, world: int, prefix: str
) -> list[StateTopic]:
    """Inputs, engine, and wheels where it has some."""
    found = [_numbers(types, f"{prefix}/commands", INPUTS, {"position": vehicle.input}, world, slice(None))]
    engine = {"velocity": vehicle.engine_speed, "effort": vehicle.engine_torque}
    found.append(_numbers(types, f"{prefix}/engine", ["engine"], engine, world, None))
    if isinstance(vehicle, TrackedVehicle):
        sprockets = {"velocity": vehicle.sprocket_speed}
        return [*found, _numbers(types, f"{prefix}/sprockets", ["left", "right"], sprockets, world, slice(None))]
    names = [side.name for side in vehicle.parts.sides]
    if vehicle.reduced is not None:
        rates = {"velocity": vehicle.reduced.turn_rate}
        found.append(_numbers(types, f"{prefix}/wheel_states", names, rates, world, slice(None)))
    else:
        turns = np.array([simulation.model.joint_dof_start[side.turn] for side in vehicle.parts.sides])
        arrays = {"position": simulation.state.joint_x, "velocity": simulation.state.joint_qd}
        found.append(_numbers(types, f"{prefix}/wheel_states", names, arrays, world, turns))
    loads = {"effort": vehicle.tires.load}
    found.append(_numbers(types, f"{prefix}/wheel_loads", names, loads, world, slice(None)))
    return found
