"""Channels of a vehicle's run that are chosen by name: tires, corners, joints, the chassis and the driveline."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable
from functools import partial
from typing import Any, Final

import numpy as np

from simwarp.core.types import JointType, formatted
from simwarp.core.wording import suggestions
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.results.channel_samples import (
    Array,
    Channel,
    Sample,
    along,
    articulation_names,
    entry,
    wheel_names_of,
)
from simwarp.vehicle.results.chassis_motion import ChassisMotion, matrices
from simwarp.vehicle.results.effort_channels import effort_channels
from simwarp.vehicle.spec.vehicle_spec import SpecError
from simwarp.vehicle.tires.soil_tires import SoilTires
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle, TrackedVehicle
from simwarp.vehicle.vehicle import Vehicle

REACTION: Final = "reaction:"
"""Begins the names of joint reactions, before the joint's name."""
RECORDED: Final = (REACTION, "torque_", "steeringwheel_")
"""Begin names of channels from reactions of joints, which only patterns with the same beginning pick."""
REACTION_PARTS: Final = ("Fx_N", "Fy_N", "Fz_N", "Mx_Nm", "My_Nm", "Mz_Nm")
ALONG_SHAFT: Final = 3
"""The part that a shaft has."""
WHEEL_PARTS: Final = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


def _level_acceleration(s: Sample, axis: int) -> Array:
    return along(s.motion.level_axes, s.acceleration, axis)


def _chassis_acceleration(s: Sample, axis: int) -> Array:
    return along(s.motion.rotation, s.acceleration, axis)


def _rate(s: Sample, axis: int) -> Array:
    return along(s.motion.rotation, s.motion.omega, axis)


def _chassis_channels() -> list[Channel]:
    found = []
    for axis, (letter, way) in enumerate(zip("xyz", ("forwards", "to the left", "up"), strict=True)):
        found += [
            Channel(
                f"a{letter}_mps2", "m/s²", f"acceleration of the chassis' centre of mass {way}, level axes",
                partial(_level_acceleration, axis=axis),
            ),
            Channel(
                f"a{letter}_chassis_mps2", "m/s²", f"the same {way} in the chassis' axes",
                partial(_chassis_acceleration, axis=axis),
            ),
        ]  # fmt: skip
    for axis, (name, meaning) in enumerate((("roll", "leans to the right"), ("pitch", "nose goes down"))):
        found.append(
            Channel(
                f"{name}rate_radps", "rad/s", f"about the chassis' {'xy'[axis]}, positive where the {meaning}",
                partial(_rate, axis=axis),
            )
        )  # fmt: skip

    def sideslip(s: Sample) -> Array:
        axes = s.motion.level_axes
        return np.arctan2(along(axes, s.motion.velocity, 1), along(axes, s.motion.velocity, 0))

    meaning = "angle from the chassis' x, laid level, to the velocity of its centre of mass; positive to the left"
    return [Channel("sideslip_rad", "rad", meaning, sideslip), *found]


def _powertrain_channels(vehicle: AnyVehicle) -> list[Channel]:
    return [
        Channel("engine_Nm", "N·m", "torque of the engine alone", lambda s: s.of(vehicle.engine_torque)),
        Channel(
            "drive_Nm", "N·m", "torque of the transmission on the drive shaft", lambda s: s.of(vehicle.drive_torque)
        ),
    ]


class _WheelAxes:
    """ISO 8855's axes of a wheel on the ground: x along its plane and the ground, z off the ground."""

    def __init__(self, simulation: Simulation, vehicle: Vehicle, wheel: int) -> None:
        self._spindle, self._vehicle, self._wheel = vehicle.parts.sides[wheel].spindle, vehicle, wheel
        self._state = simulation.state
        tire = vehicle.parts.spec.all_axles[vehicle.parts.sides[wheel].axle].tire
        self._radius = tire.radius
        plane = getattr(vehicle.tires, "terrain", None)
        self._plane = None if plane is None else plane.rot.numpy().astype(float)[:, :, 2]

    def axes(self, s: Sample) -> tuple[Array, Array]:
        """(n, 3, 3) with the axes as columns, and (n, 3) the wheel's own axis to the left."""
        axle = self._axle(s)
        up = np.array([[0.0, 0.0, 1.0]]) if self._plane is None else self._plane
        z = np.broadcast_to(up if len(up) == 1 else up[s.worlds], axle.shape)
        x = np.cross(axle, z)
        x /= np.linalg.norm(x, axis=1)[:, None]
        return np.stack([x, np.cross(z, x), z], axis=-1), axle

    def _axle(self, s: Sample) -> Array:
        """(n, 3) the wheel's own axis."""
        reduced = self._vehicle.reduced
        if reduced is None:
            return np.asarray(matrices(s.of(self._state.body_rot)[:, self._spindle])[:, :, 1])
        return np.asarray(np.einsum("wij,wj->wi", s.motion.rotation, s.of(reduced.axis)[:, self._wheel]))

    def force(self, s: Sample, part: int) -> Array:
        """Force on the wheel along an axis, or from 3 on the moment about the middle of the contact."""
        axes, axle = self.axes(s)
        tires = self._vehicle.tires
        force = s.of(tires.force_w)[:, self._wheel]
        if part < 3:
            return along(axes, force, part)
        depth = 0.0 if isinstance(tires, SoilTires) else s.of(tires.deflection)[:, self._wheel, None]
        upwards = np.cross(axes[:, :, 0], axle)
        center = upwards * (self._radius - depth)
        moment = s.of(tires.torque_w)[:, self._wheel] + np.cross(center, force)
        return along(axes, moment, part - 3)


def _wheel_channels(simulation: Simulation, vehicle: Vehicle) -> list[Channel]:
    found, tires, model = [], vehicle.tires, simulation.model
    on_soil = isinstance(tires, SoilTires)
    readings: list[tuple[str, str, str, str, str]] = [
        ("slip_ratio", "slip", "", "1", "slip ratio, positive when driving"),
        ("slip_angle", "slipangle", "_rad", "rad", "positive where the wheel drifts to the left"),
        ("camber", "camber", "_rad", "rad", "inclination, positive where the top leans to the right"),
        (
            "deflection",
            "sink" if on_soil else "deflection",
            "_m",
            "m",
            "depth in the soil" if on_soil else "of the tire",
        ),
    ]
    for wheel, name in enumerate(wheel_names_of(vehicle.parts.spec)):
        side = vehicle.parts.sides[wheel]
        for field, short, ending, unit, meaning in readings:
            found.append(
                Channel(
                    f"{short}_{name}{ending}", unit, meaning,
                    partial(entry, source=tires, field=field, index=wheel),
                )
            )  # fmt: skip
        axes = _WheelAxes(simulation, vehicle, wheel)
        for part, letters in enumerate(WHEEL_PARTS):
            unit = "N" if part < 3 else "N·m"
            what = "ground's force on the wheel" if part < 3 else "its moment about the middle of the contact"
            found.append(
                Channel(
                    f"{letters}_{name}_{unit.replace('·', '')}", unit, f"{what}, along {'xyz'[part % 3]} of its W axes",
                    partial(axes.force, part=part),
                )
            )  # fmt: skip
        spins = partial(entry, source=vehicle.reduced, field="turn_rate", index=wheel)
        if vehicle.reduced is None:
            turn = model.joint_dof_start[side.turn]
            spins = partial(entry, source=simulation.state, field="joint_qd", index=turn)
        found.append(
            Channel(f"spin_{name}_radps", "rad/s", "of the wheel seen from the chassis, positive forwards", spins)
        )
        found += _corner_channels(simulation, vehicle, wheel, name)
    return found


def _corner_channels(simulation: Simulation, vehicle: Vehicle, wheel: int, name: str) -> list[Channel]:
    """Travel of the wheel, and length and force of its springs."""
    side, parts, state = vehicle.parts.sides[wheel], vehicle.parts, simulation.state
    if vehicle.reduced is not None:
        travels = partial(entry, source=vehicle.reduced, field="travel", index=wheel)
        meaning = "of the wheel's centre up along the chassis' z, from as the full vehicle is built"
        return [Channel(f"travel_{name}_m", "m", meaning, travels)]
    bodies = simulation.model.builder.bodies
    chassis = parts.unit_of(side.axle).chassis
    built = matrices(np.asarray(bodies[chassis].pose.rotation, float))
    zero = built.T @ (
        np.asarray(bodies[side.spindle].pose.position, float) - np.asarray(bodies[chassis].pose.position, float)
    )

    def travel(s: Sample) -> Array:
        places, turn = s.of(state.body_x), s.motion.rotation
        if chassis != parts.chassis:
            turn = matrices(s.of(state.body_rot)[:, chassis].astype(float))
        return along(turn, places[:, side.spindle] - places[:, chassis], 2) - zero[2]

    found = [Channel(f"travel_{name}_m", "m", "of the wheel's centre up along the chassis' z, from as built", travel)]
    place = "left" if side.side > 0.0 else "right"
    begin = f"{parts.prefix}axle{side.axle}.{place}.spring"
    for index, joint in enumerate(j for j, text in enumerate(simulation.model.joint_names) if text.startswith(begin)):
        number = "" if index == 0 else str(index + 1)
        dof = simulation.model.joint_dof_start[joint]
        found.append(
            Channel(
                f"springlength{number}_{name}_m", "m", "between the ends of the spring",
                partial(entry, source=state, field="joint_q", index=dof),
            )
        )  # fmt: skip
        found += _line_channels(simulation, joint, f"{number}_{name}_N")
    return found


def _line_channels(simulation: Simulation, joint: int, ending: str) -> list[Channel]:
    """Forces of a spring and of a damper, of lines that are such, positive where they push the ends apart."""
    model, state = simulation.model, simulation.state
    dof, law = model.joint_dof_start[joint], model.builder.joints[joint].dofs[0]

    def spring(s: Sample) -> Array:
        stretch = _tabled(law.spring_table, s.of(state.joint_q)[:, dof] - s.of(model.joint_rest)[:, dof])
        return np.asarray(s.of(model.joint_preload)[:, dof] - s.of(model.joint_stiffness)[:, dof] * stretch)

    def damper(s: Sample) -> Array:
        q, qd = s.of(state.joint_q)[:, dof], s.of(state.joint_qd)[:, dof]
        rate = _tabled(law.damper_table, qd) if law.damper_map is None else _mapped(law.damper_map, q, qd)
        return np.asarray(-s.of(model.joint_damping)[:, dof] * rate)

    found = []
    if law.stiffness or law.preload or law.spring_table is not None:
        found.append(Channel(f"spring{ending}", "N", "of the spring with its preload, pushes the ends apart", spring))
    if law.damping or law.damper_table is not None or law.damper_map is not None:
        found.append(Channel(f"damper{ending}", "N", "of the damper, pushes the ends apart", damper))
    return found


def _mapped(table: Any, x: Array, y: Array) -> Array:
    """Values of a `damper_map` at places x, those of its ends beyond them, and rates y, straight on beyond its ends."""
    places, rates, forces = table
    columns = np.array([_tabled((rates, column), y) for column in zip(*forces, strict=True)])  # (places, n)
    return np.array([np.interp(at, places, column) for column, at in zip(columns.T, x, strict=True)])


def _tabled(table: Any, x: Array) -> Array:
    """Piecewise linear values at x, straight on beyond the ends; x itself where there is no table."""
    if table is None:
        return x
    places, values = (np.asarray(each, float) for each in table)
    first = np.clip(np.searchsorted(places, x, side="right") - 1, 0, len(places) - 2)
    slope = np.diff(values)[first] / np.diff(places)[first]
    return np.asarray(values[first] + slope * (x - places[first]))


def _train_channels(vehicle: Vehicle) -> list[Channel]:
    """Angles between a vehicle and its trailers."""
    return [
        Channel(
            name, "rad", "yaw of the trailer seen from the unit before it, positive to the left",
            partial(entry, source=vehicle, field="articulation", index=number),
        )
        for number, name in enumerate(articulation_names(vehicle.parts.spec))
    ]  # fmt: skip


def _reaction_channels(simulation: Simulation) -> list[Channel]:
    """Of every joint; they can be read in a Simulation with `joint_reactions=True`. Of shafts the torque along them."""
    found, diagnostics, joints = [], simulation.diagnostics, simulation.model.builder.joints
    for joint, name in enumerate(simulation.model.joint_names):
        shaft = joints[joint].type is JointType.SHAFT
        for part, ending in enumerate(REACTION_PARTS):
            if shaft and part != ALONG_SHAFT:
                continue
            what = "force" if part < 3 else "torque about anchor 1"
            meaning = f"{what} of the joint on its second body, world {'xyz'[part % 3]}, at the last step's first pose"
            if shaft:
                meaning = "torque along the shaft of all but couplings: motors, prescribed motion, springs, friction"

            def read(s: Sample, joint: int = joint, part: int = part) -> Array:
                reactions = diagnostics.joint_reaction_force if part < 3 else diagnostics.joint_reaction_torque
                return s.of(reactions)[:, joint, part % 3]

            found.append(Channel(f"{REACTION}{name}.{ending}", "N" if part < 3 else "N·m", meaning, read, True))
    return found


def channels_of(simulation: Simulation, vehicle: AnyVehicle) -> tuple[Channel, ...]:
    """All channels that can be chosen of a vehicle."""
    found = [*_chassis_channels(), *_powertrain_channels(vehicle)]
    if not isinstance(vehicle, TrackedVehicle):
        found += _wheel_channels(simulation, vehicle)
        found += effort_channels(simulation, vehicle)
        found += _train_channels(vehicle)
    return (*found, *_reaction_channels(simulation))


def _names_recorded(pattern: str) -> bool:
    """Whether a pattern may pick channels that are recorded with reactions: `*` alone does not."""
    return pattern.startswith(RECORDED)


def wants_reactions(patterns: Iterable[str]) -> bool:
    """Whether a Simulation needs `joint_reactions=True` for channels of these patterns."""
    return any(_names_recorded(pattern) for pattern in patterns)


def chosen(known: Iterable[Channel], patterns: Iterable[str], columns: Iterable[str] = ()) -> tuple[Channel, ...]:
    """Those that patterns as of file names (`Fx_*`) pick, each once, in the order of the patterns.

    A joint's name behind `reaction:` picks all of its parts. Channels that are columns already are left out.

    Raises:
        SpecError: a pattern picks nothing.
    """
    channels, usual = {channel.name: channel for channel in known}, set(columns)
    recorded = {channel.name for channel in channels.values() if channel.recorded}
    found: dict[str, Channel] = {}
    for pattern in patterns:
        among = [name for name in (*channels, *usual) if _names_recorded(pattern) or name not in recorded]
        names = [name for name in among if fnmatch.fnmatchcase(name, pattern)]
        if not names and pattern.startswith(REACTION):
            names = [name for name in among if fnmatch.fnmatchcase(name.rpartition(".")[0], pattern)]
        if not names:
            near = suggestions(pattern, among or list(channels), "simwarp drive VEHICLE --channels list prints them")
            raise SpecError(f"channels: must be names or patterns of channels, got {formatted(pattern)}; {near}")
        found |= {name: channels[name] for name in names if name not in usual}
    return tuple(found.values())


class NamedReadings:
    """Chosen channels from the arrays of a Simulation.

    Raises:
        SpecError: a pattern picks nothing, or reactions are asked of a Simulation that does not record them.
    """

    def __init__(
        self, simulation: Simulation, vehicle: AnyVehicle, patterns: Iterable[str], columns: Iterable[str]
    ) -> None:  # fmt: skip
        patterns = tuple(patterns)
        self.channels = chosen(channels_of(simulation, vehicle), patterns, columns) if patterns else ()
        self._simulation = simulation
        self._last: ChassisMotion | None = None
        reaction = next((each.name for each in self.channels if each.recorded), None)
        if reaction is not None and simulation.diagnostics.joint_reaction_force.size == 0:
            rule = "needs a Simulation with joint_reactions=True, got one without; make it with them"
            raise SpecError(f"channels: {reaction!r} {rule}")

    def read(self, motion: ChassisMotion, worlds: slice) -> dict[str, Array]:
        """(n,) by name, of the present state; accelerations are means since the last reading, 0 at the first."""
        acceleration = np.zeros_like(motion.velocity)
        if self._last is not None:
            elapsed = np.maximum(motion.time - self._last.time, 1e-9)[:, None]
            acceleration = (motion.velocity - self._last.velocity) / elapsed
        self._last = motion
        sample = Sample(self._simulation, motion, worlds, acceleration)
        return {channel.name: channel.read(sample) for channel in self.channels}
