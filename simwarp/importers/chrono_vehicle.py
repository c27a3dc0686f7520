"""Vehicles of Project Chrono: its JSON files, as they are, to our descriptions.

A vehicle's file names those of its subsystems relative to a root, Chrono's folder `data/vehicle`. Engine, transmission
and tires are files of their own that Chrono's programs choose; here they are arguments:

    spec = load_chrono_vehicle(
        "data/vehicle/hmmwv/vehicle/HMMWV_Vehicle_4WD.json",
        engine="hmmwv/powertrain/HMMWV_EngineShafts.json",
        transmission="hmmwv/powertrain/HMMWV_AutomaticTransmissionShafts.json",
        tire="hmmwv/tire/HMMWV_TMeasyTire.json",
    )

Comments are allowed, quaternions are scalar first, angles in degrees, engine speeds in rpm. Keys that only pictures
use are left out; any other unknown key is an error that names the file.
"""

from __future__ import annotations

import dataclasses
import os
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from simwarp.core.types import formatted
from simwarp.core.wording import shortened
from simwarp.importers.chrono_axles import AXLES, Points, hung_on_chassis, with_points
from simwarp.importers.chrono_drivetrain import BRAKES, DRIVELINES, ENGINES, STEERINGS, TRANSMISSIONS
from simwarp.importers.chrono_generic import GENERIC
from simwarp.importers.chrono_json import Node, of_matrix
from simwarp.importers.chrono_rear_chassis import Frames, read_frames
from simwarp.importers.chrono_suspensions import SUSPENSIONS, antiroll_bar
from simwarp.importers.chrono_tires import TIRES
from simwarp.vehicle.spec.parts import inertia_matrix
from simwarp.vehicle.spec.plausibility import is_point
from simwarp.vehicle.spec.vehicle_spec import (
    ZERO,
    AntirollBar,
    Axle,
    Brake,
    Chassis,
    RigidPart,
    RigidSuspension,
    Spec,
    SpecError,
    SteeringMount,
    Vec3,
    VehicleSpec,
    Wheel,
)

T = TypeVar("T")

WHEELBASE_TOLERANCE = 0.02
NO_STEERING = -1
"""Index of the steering of an axle that has none, in Chrono."""
NEAR_GROUND = 0.1
"""Of a tire's radius: how far from the ground a wheel may start."""


def load_chrono_vehicle(
    vehicle_json: str | Path,
    *,
    engine: str | Path | None = None,
    transmission: str | Path | None = None,
    tire: str | Path | Sequence[str | Path] | None = None,
    root: str | Path | None = None,
) -> VehicleSpec:
    """The vehicle of a Chrono file of type Vehicle, template WheeledVehicle.

    Args:
        vehicle_json: its path.
        engine: file of its engine, given together with a transmission.
        transmission: file of its transmission.
        tire: file of its tires, or one file for each axle.
        root: the folder that file names are relative to; None: the nearest folder above the vehicle's file in which
            its chassis is found.

    Raises:
        SpecError: a file that cannot be read, an unknown key or template, or a value that breaks a rule.
    """
    node = Node.of_file(Path(vehicle_json))
    expect(node, "Vehicle", ("WheeledVehicle",))
    if "Vehicle" in node:
        return whole_vehicle(node, Path(vehicle_json), engine, transmission, tire, root)
    node, chassis_file, files = open_vehicle(Path(vehicle_json), "WheeledVehicle", root)
    # What Chrono declares for its path-following drivers; ours follow from the geometry.
    node.skip("Minimum Turning Radius", "Maximum Steering Angle (deg)", "Maximum Steering Angle")
    mounts = list(node.each("Steering Subsystems")) if "Steering Subsystems" in node else []
    frames = read_frames(node, files.node(chassis_file), files, len(mounts), components_of)
    steerings = tuple(read_steering(mount, files, frames) for mount in mounts)
    axles = read_axles(node, files, tire, frames)
    read_chassis = {"RigidChassis": chassis}
    spec = node.make(
        VehicleSpec,
        name=node.text("Name") if "Name" in node else Path(vehicle_json).stem,
        chassis=files.part("Chassis", read_chassis, chassis_file, links_on_chassis(node, files, frames), frames.held),
        axles=axles,
        steerings=(*steerings, *frames.mounts),
        driveline=read_driveline(node, files) if "Driveline" in node else None,
        engine=None if engine is None else files.part("Engine", ENGINES, engine),
        transmission=None if transmission is None else files.part("Transmission", TRANSMISSIONS, transmission),
        wheelbase=wheelbase(node, axles),
        start_height=start_height(axles),
    )
    node.finish()
    return spec


def read_steering(node: Node, files: Files, frames: Frames) -> SteeringMount:
    """A steering with its place."""
    offset, steered = frames.of_part(node)
    if steered is not None:
        raise node.place.at("Chassis Index").error("must be a chassis that no joint steers; leave the steering out")
    x, y, z = (float(value) for value in np.add(offset, node.vector("Location")))
    part = files.part("Steering", STEERINGS, node.text("Input File"))
    return SteeringMount(steering=part, location=(x, y, z), rotation=node.quaternion("Orientation"))


def whole_vehicle(
    node: Node, path: Path, engine: str | Path | None, transmission: str | Path | None,
    tire: str | Path | Sequence[str | Path] | None, root: str | Path | None,
) -> VehicleSpec:  # fmt: skip
    """A file that names a vehicle's file and its tires. Its older powertrain is left out: give engine and transmission.

    Chrono's own are partly out of date: a vehicle's file that is not where they say is looked for beside them.
    """
    node.skip("Zombie")
    parts = {key: node.child(key) for key in ("Vehicle", "Tire", "Powertrain") if key in node}
    for part in parts.values():
        part.skip(*(key for key in part.value if key.endswith("Visualization Type")))
    named = parts["Vehicle"].text("Input File")
    inside = [folder / named for folder in ((Path(root),) if root else path.resolve().parents)]
    found = next((file for file in inside if os.path.isfile(file)), path.parent / Path(named).name)
    if not os.path.isfile(found):
        rule = f"must be the file of a vehicle, but {formatted(named)} is in no folder above it, nor beside it"
        raise parts["Vehicle"].place.at("Input File").error(f"{rule}; give root=, Chrono's data/vehicle")
    if "Powertrain" in parts and engine is None:
        parts["Powertrain"].text("Input File")
        remedy = "give engine= and transmission=, files of their own"
        warnings.warn(f"{path.name}: Powertrain: left out; {remedy}", stacklevel=3)
    own = parts["Tire"].text("Input File") if "Tire" in parts else None
    spec = load_chrono_vehicle(
        found, engine=engine, transmission=transmission, tire=own if tire is None else tire, root=root
    )
    parts.get("Powertrain", node).skip("Input File")
    node.finish()
    return dataclasses.replace(spec, name=node.text("Name")) if "Name" in node else spec


def open_vehicle(path: Path, template: str, root: str | Path | None) -> tuple[Node, str, Files]:
    """The object of a vehicle's file, the name of its chassis' file, and the files of its subsystems.

    Raises:
        SpecError: it cannot be read, is of another template, or there is no such chassis.
    """
    node = Node.of_file(path)
    expect(node, "Vehicle", (template,))
    chassis_file = node.child("Chassis").text("Input File")
    return node, chassis_file, Files(find_root(path, chassis_file) if root is None else Path(root))


def find_root(path: Path, file: str) -> Path:
    """The nearest folder above a vehicle's file that holds another file by its name."""
    for folder in path.resolve().parents:
        if os.path.isfile(folder / file):  # of a path that no file can have it says no
            return folder
    raise SpecError(
        f"{path.name}: Chassis.Input File: {formatted(file)} is in no folder above it; give root=, Chrono's "
        "data/vehicle"
    )


class Files:
    """Reads the files of subsystems."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def node(self, file: str | Path) -> Node:
        """The object of a file: relative to the root, or a path from here."""
        inside = self.root / file
        if not os.path.isfile(inside) and not os.path.isfile(file):
            raise SpecError(f"{shortened(file)}: cannot be read: no such file, neither here nor in {self.root}")
        return Node.of_file(inside if os.path.isfile(inside) else Path(file))

    def part(self, kind: str, readers: Mapping[str, Callable[..., T]], file: str | Path, *more: Any) -> T:
        """The description of a file by the reader of its template."""
        node = self.node(file)
        part = readers[expect(node, kind, readers)](node, *more)
        node.finish()
        return part


def expect(node: Node, kind: str, templates: Collection[str]) -> str:
    """The template of an object, which must be of a kind and one of those known."""
    node.choice("Type", (kind,))
    return node.choice("Template", templates)


def read_axles(
    node: Node, files: Files, tire: str | Path | Sequence[str | Path] | None, frames: Frames
) -> tuple[Axle, ...]:
    """All axles, with the given tires."""
    axles = list(node.each("Axles"))
    if tire is None:
        raise node.place.error("tire: missing; Chrono's vehicles name none: give tire='.../HMMWV_TMeasyTire.json'")
    tires = [tire] * len(axles) if isinstance(tire, (str, Path)) else list(tire)
    if len(tires) != len(axles):
        raise node.place.error(f"tire: must be one file, or one for each of {len(axles)} axles, got {len(tires)}")
    return tuple(read_axle(axle, files, file, frames) for axle, file in zip(axles, tires, strict=True))


def read_axle(node: Node, files: Files, tire: str | Path, frames: Frames) -> Axle:
    """One axle; left and right must be alike. A frame that is farther from its wheels than a radius moves to them."""
    node.skip("Subchassis Index")  # its beam is held
    offset, steering = frames.of_part(node)
    x, y, z = (float(value) for value in np.add(offset, node.vector("Suspension Location")))
    suspension = files.part("Suspension", SUSPENSIONS | AXLES | GENERIC, node.text("Suspension Input File"))
    fitted = files.part("Tire", TIRES, tire, files.root)
    if "Wheel Separation" in node and node.number("Wheel Separation", "m") != 0.0:
        rule = "must be 0 or left out: an axle has one tire on each side here"
        raise node.place.at("Wheel Separation").error(f"{rule}; give one wheel and one tire that stand for both")
    if steering is None:
        steering = node.whole("Steering Index") if "Steering Index" in node else None
        steering = None if steering == NO_STEERING else steering
    elif not isinstance(suspension, RigidSuspension):
        rule = f"must be rigid on a chassis that a joint steers, got {suspension.template}"
        raise node.place.at("Suspension Input File").error(f"{rule}; only axles without springs turn with it")
    behind = suspension.spindle.com[0]
    if abs(behind) > fitted.radius:
        x, suspension = x + behind, shifted(suspension, -behind)
    return node.make(
        Axle,
        location=(x, y, z),
        suspension=suspension,
        wheel=both_sides(node, files, "Wheel", {"Wheel": wheel}),
        tire=fitted,
        brake=read_brake(node, files),
        steering=steering,
        antiroll_bar=read_antiroll_bar(node, files, offset),
    )


def shifted(part: T, ahead: float) -> T:
    """A description with all its places moved along x [m]."""
    changes: dict[str, Any] = {}
    for field in dataclasses.fields(part):  # type: ignore[arg-type]
        value: Any = getattr(part, field.name)
        if isinstance(value, Spec):
            changes[field.name] = shifted(value, ahead)
        elif isinstance(value, tuple) and value and isinstance(value[0], Spec):
            changes[field.name] = tuple(shifted(each, ahead) for each in value)
        elif isinstance(value, tuple) and len(value) == len(ZERO) and is_point(field.name):
            changes[field.name] = (value[0] + ahead, value[1], value[2])
    return dataclasses.replace(part, **changes)  # type: ignore[type-var]


def links_on_chassis(node: Node, files: Files, frames: Frames) -> Points:
    """Masses of links that hang on the chassis, of all axles."""
    found: Points = []
    for axle in node.each("Axles"):
        suspension = files.node(axle.text("Suspension Input File"))
        x, y, z = (float(v) for v in np.add(frames.of_part(axle)[0], axle.vector("Suspension Location")))
        found += hung_on_chassis(suspension, (x, y, z))
    return found


def read_brake(node: Node, files: Files) -> Brake | None:
    """The brakes of an axle."""
    if "Left Brake Input File" not in node and "Right Brake Input File" not in node:
        return None
    return both_sides(node, files, "Brake", BRAKES)


def read_antiroll_bar(node: Node, files: Files, offset: Vec3) -> AntirollBar | None:
    """The anti-roll bar of an axle, at a place in its chassis' frame, which is `offset` from the vehicle's."""
    if "Antirollbar Input File" not in node:
        return None
    x, y, z = (float(value) for value in np.add(offset, node.vector("Antirollbar Location")))
    location = x, y, z
    return files.part("Antirollbar", {"AntirollBarRSD": antiroll_bar}, node.text("Antirollbar Input File"), location)


def both_sides(node: Node, files: Files, kind: str, readers: Mapping[str, Callable[..., T]]) -> T:
    """A part that is given for the left and for the right."""
    left, right = (files.part(kind, readers, node.text(f"{side} {kind} Input File")) for side in ("Left", "Right"))
    if left != right:
        place = node.place.at(f"Right {kind} Input File")
        raise place.error(f"must be like the left one: an axle has one {kind.lower()} for both sides")
    return left


def wheel(node: Node) -> Wheel:
    """Wheel."""
    return node.make(Wheel, mass=node.number("Mass", "kg"), inertia=node.vector("Inertia", "kg·m²"))


def read_driveline(node: Node, files: Files) -> Any:
    """The driveline with its driven axles."""
    drive = node.child("Driveline")
    indices = drive.get("Suspension Indexes", "a list of the driven axles")
    count = len(node.value["Axles"])
    if not isinstance(indices, list) or not all(isinstance(i, int) and 0 <= i < count for i in indices):
        raise drive.place.at("Suspension Indexes").error(
            f"must be a list of axles below {count}, got {formatted(indices)}"
        )
    axles = tuple(indices)
    return files.part("Driveline", DRIVELINES, drive.text("Input File"), axles)


def wheelbase(node: Node, axles: Sequence[Axle]) -> float | None:
    """The declared wheelbase; Chrono never checks it, so that one that is not the axles' is left out with a warning."""
    if "Wheelbase" not in node:
        return None
    declared = node.number("Wheelbase", "m")
    first, last = axles[0], axles[-1]
    frames = first.location[0] - last.location[0]
    wheels = frames + first.suspension.spindle.com[0] - last.suspension.spindle.com[0]
    if min(abs(frames - declared), abs(wheels - declared)) <= WHEELBASE_TOLERANCE * declared:
        return declared
    warnings.warn(
        f"{node.place.file}: Wheelbase: {declared} m is not that of the axles, {wheels:.4g} m; left out",
        stacklevel=3,
    )
    return None


def start_height(axles: Sequence[Axle]) -> float:
    """Half a metre, as in Chrono's programs, unless that leaves the lowest wheel clearly off the ground or in it."""
    usual: float = VehicleSpec.start_height
    bottoms = [(axle.location[2] + axle.suspension.spindle.com[2] - axle.tire.radius, axle) for axle in axles]
    bottom, lowest = min(bottoms, key=lambda pair: pair[0])
    return usual if abs(usual + bottom) <= NEAR_GROUND * lowest.tire.radius else -bottom


# ---- chassis ---------------------------------------------------------------------------------------------------------


def chassis(node: Node, links: Points = (), held: Sequence[RigidPart] = ()) -> Chassis:  # type: ignore[assignment]
    """RigidChassis: components in axes of the vehicle, with others that it holds.

    The last component bears what links of the suspensions leave to the chassis.
    """
    components = [*components_of(node), *held]
    if "Contact" in node:
        node.skip("Contact")
        remedy = "add_chassis_box adds a box that stands for the vehicle in contacts"
        warnings.warn(f"{node.place.file}: Contact: left out; {remedy}", stacklevel=2)
    if components:
        components[-1] = with_points(node, components[-1], links)
    return node.make(Chassis, components=tuple(components))


def components_of(node: Node) -> list[RigidPart]:
    """Components of a chassis in its axes; voids are taken out of one merged component."""
    components: list[RigidPart] = []
    voids: list[RigidPart] = []
    for component in node.each("Components"):
        void = component.flag("Void")
        (voids if void else components).append(turned_part(component))
    if voids:
        components = [hollow(node, components, voids)]
    return [as_a_body(node, part) for part in components]


def as_a_body(node: Node, part: RigidPart) -> RigidPart:
    """A component whose largest moment of inertia is at most the sum of the others, as that of any body is."""
    moments, axes = np.linalg.eigh(inertia_matrix(part))
    most = float(moments[0] + moments[1])
    if moments[2] <= most:
        return part
    found, rule = f"{moments[2]:.6g} kg·m²", "no body's: above the sum of the others"
    warnings.warn(
        f"{node.place.file}: Components: a moment of inertia of {found} is {rule}, which it is lowered to, {most:.6g}",
        stacklevel=2,
    )
    moments[2] = most
    return of_matrix(node, part.mass, np.array(part.com), axes @ np.diag(moments) @ axes.T)


def turned_part(node: Node) -> RigidPart:
    """A component, its inertia turned from its own axes into those of the vehicle."""
    frame = node.child("Centroidal Frame")
    part = node.part(frame.vector("Location"))
    x, y, z, w = frame.quaternion("Orientation")
    if (x, y, z) == (0.0, 0.0, 0.0):
        return part
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return of_matrix(node, part.mass, np.array(part.com), turn @ inertia_matrix(part) @ turn.T)


def hollow(node: Node, parts: Sequence[RigidPart], voids: Sequence[RigidPart]) -> RigidPart:
    """One part: the sum of parts less that of voids."""
    signed = [(1.0, part) for part in parts] + [(-1.0, part) for part in voids]
    mass = sum(sign * part.mass for sign, part in signed)
    if mass <= 0.0:
        raise node.place.at("Components").error(f"must weigh more than their voids, got {mass} kg in all")
    com = np.sum([sign * part.mass * np.array(part.com) for sign, part in signed], axis=0) / mass
    inertia = np.zeros((3, 3))
    for sign, part in signed:
        arm = np.array(part.com) - com
        inertia += sign * (inertia_matrix(part) + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm)))
    return of_matrix(node, mass, com, inertia)
