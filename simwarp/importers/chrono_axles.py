"""Chrono's beam axles and its three-link suspension to ours.

Links are bodies there and massless rods here: each link's mass lies on what its ends hang on, shared so that its
centre of mass stays, or half and half where the file has none. Masses, centres of mass and static loads are Chrono's;
a link's own inertia, and that of anti-roll bars, is replaced by that of two points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from simwarp.importers.chrono_json import Node, of_matrix
from simwarp.importers.chrono_suspensions import common, force_line, turned
from simwarp.vehicle.spec.parts import merged
from simwarp.vehicle.spec.vehicle_spec import (
    AxleRod,
    BeamAxle,
    BellCrank,
    ForceLine,
    RigidPart,
    Suspension,
    ThreeLink,
    TriangularArm,
    Vec3,
)

Points = list[tuple[float, Vec3]]
"""Masses [kg] at places [m]."""


class Link(NamedTuple):
    """A link of a file: what it weighs [kg], and its ends [m]."""

    mass: float
    chassis: Vec3
    axle: Vec3
    mirrored: bool = True
    share: float = 0.5
    """Of the mass at the axle's end."""

    def points(self, *, on_axle: bool) -> Points:
        """What it adds to the axle, or to the chassis."""
        place, share = (self.axle, self.share) if on_axle else (self.chassis, 1.0 - self.share)
        sides = (1.0, -1.0) if self.mirrored else (1.0,)
        return [(share * self.mass, (place[0], side * place[1], place[2])) for side in sides]


def link(node: Node, axle: str = "Location Axle", *, mirrored: bool = True) -> Link:
    """A link from "Location Chassis" to another place; its "Inertia" is left out."""
    node.skip("Inertia", "Universal Joint Axis")
    start, end = node.vector("Location Chassis"), node.vector(axle)
    share = 0.5
    if "COM" in node:
        way = np.subtract(end, start)
        share = float(np.clip(np.subtract(node.vector("COM"), start) @ way / max(way @ way, 1e-12), 0.0, 1.0))
    return Link(node.number("Mass", "kg"), start, end, mirrored, share)


def with_points(node: Node, part: RigidPart, points: Iterable[tuple[float, Vec3]]) -> RigidPart:
    """A part with points fixed to it."""
    found = [(mass, np.array(place)) for mass, place in points if mass > 0.0]
    if not found:
        return part
    own, place, inertia = merged([part])
    mass = own + sum(each for each, _ in found)
    com = (own * place + sum(each * at for each, at in found)) / mass
    for each, at in [(own, place), *found]:
        arm = at - com
        inertia = inertia + each * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return of_matrix(node, mass, com, inertia)


# ---- what hangs on the chassis ---------------------------------------------------------------------------------------


def triangular(node: Node) -> Link:
    """A triangular link, seen in its middle plane."""
    found = link(node.child("Triangular Link"), mirrored=False)
    (cx, _, cz), (ax, _, az) = found.chassis, found.axle
    return found._replace(chassis=(cx, 0.0, cz), axle=(ax, 0.0, az))


def three_links(node: Node) -> list[Link]:
    """Of SolidThreeLinkAxle."""
    return [triangular(node), link(node.child("Longitudinal Link"))]


def bell_crank_links(node: Node) -> list[Link]:
    """Of SolidBellcrankThreeLinkAxle; the tie rods hang on knuckles and bell crank."""
    rod = node.child("Draglink")
    rod.skip("Inertia")
    ends = rod.vector("Location Steering"), rod.vector("Location Bellcrank")
    return [*three_links(node), Link(rod.number("Mass", "kg"), *ends, mirrored=False)]


def solid_links(node: Node) -> list[Link]:
    """Of SolidAxle."""
    found = [link(node.child("Upper Link")), link(node.child("Lower Link"))]
    found.append(link(node.child("Draglink"), "Location Bell Crank", mirrored=False))
    if "Trackbar" in node:
        found.append(link(node.child("Trackbar"), mirrored=False))
    return found


def toe_bar_links(node: Node) -> list[Link]:
    """Drag link of the axles whose tie rod joins both knuckles."""
    rod, knuckle = node.child("Draglink"), node.child("Knuckle")
    rod.skip("Inertia")
    ends = rod.vector("Location Chassis"), knuckle.vector("Location Draglink")
    return [Link(rod.number("Mass", "kg"), *ends, mirrored=False)]


def panhard_links(node: Node) -> list[Link]:
    """Panhard rod, and the arms of an anti-roll bar."""
    found = [link(node.child("Panhard Rod"), mirrored=False)]
    if "Anti Roll Bar" in node:
        bar = node.child("Anti Roll Bar")
        bar.skip("Rotational Stiffness", "Rotational Damping")
        found.append(link(bar))
    return found


def watt_links(node: Node) -> list[Link]:
    """Side links of DeDionAxle, from the chassis to the middle of the Watt linkage on the tube."""
    part = node.child("Watt Mechanism")
    part.skip("Center Link Inertia", "Side Link Inertia", "Link Radius")
    mass = part.number("Side Link Mass", "kg")
    sides = [[part.vector(f"Location {side} Link to {end}") for end in ("Chassis", "Center")]
             for side in ("Left", "Right")]  # fmt: skip
    return [Link(mass, start, end, mirrored=False) for start, end in sides]


def push_pipe_links(node: Node) -> list[Link]:
    """Panhard rod of PushPipeAxle."""
    rod = node.child("Panhard Rod")
    rod.skip("Inertia")
    ends = [rod.vector(f"Location Connector {end}") for end in ("Chassis", "Axle")]
    return [Link(rod.number("Mass", "kg"), ends[0], ends[1], mirrored=False)]


def hendrickson_links(node: Node) -> list[Link]:
    """Of HendricksonPRIMAXX. Chrono joins the transverse beam to nothing; here it is part of the housing."""
    found = []
    for name in ("Lower Beam", "Torque Rod"):
        part = node.child(name)
        part.skip("Inertia", "COM", "Transverse Beam Attachment Point")
        ends = part.vector("Chassis Attachment Point"), part.vector("Axle Housing Attachment Point")
        found.append(Link(part.number("Mass", "kg"), *ends))
    return found


def trailing_links(node: Node) -> list[Link]:
    """Of ThreeLinkIRS, whose arm is a body."""
    return [link(node.child(name), "Location Arm") for name in ("Upper Link", "Lower Link")]


LINKS: Final[dict[str, Callable[[Node], list[Link]]]] = {
    "SolidThreeLinkAxle": three_links, "SolidBellcrankThreeLinkAxle": bell_crank_links, "SolidAxle": solid_links,
    "LeafspringAxle": lambda node: [], "ToeBarLeafspringAxle": toe_bar_links, "RigidPanhardAxle": panhard_links,
    "ToeBarRigidPanhardAxle": lambda node: [*panhard_links(node), *toe_bar_links(node)],
    "ThreeLinkIRS": trailing_links, "HendricksonPRIMAXX": hendrickson_links,
    "DeDionAxle": watt_links, "ToeBarDeDionAxle": lambda node: [*watt_links(node), *toe_bar_links(node)],
    "PushPipeAxle": push_pipe_links,
    "ToeBarPushPipeAxle": lambda node: [*push_pipe_links(node), *toe_bar_links(node)],
}  # fmt: skip
"""Links that end at the chassis, by the template of a suspension."""


def hung_on_chassis(node: Node, location: Vec3) -> Points:
    """Masses that a suspension's links leave to the chassis, in the vehicle's frame of reference; none of others."""
    found = LINKS.get(node.text("Template"))
    points = [] if found is None else [point for each in found(node) for point in each.points(on_axle=False)]
    return [(mass, (x + location[0], y + location[1], z + location[2])) for mass, (x, y, z) in points]


# ---- axles -----------------------------------------------------------------------------------------------------------


def springs(node: Node, end: str = "Location Axle") -> tuple[ForceLine, ForceLine]:
    """Spring and shock."""
    return force_line(node.child("Spring"), end), force_line(node.child("Shock"), end, damper=True)


def beam(node: Node, links: Sequence[Link], **fields: Any) -> BeamAxle:
    """Parts that all beams have; the tube bears what its links leave to it."""
    tube = node.child("Axle Tube")
    hung = [point for each in links for point in each.points(on_axle=True)]
    part = with_points(tube, tube.part(), hung)
    return node.make(BeamAxle, **common(node), axle_tube=part, springs=springs(node), **fields)


def knuckle(node: Node, tierod_end: Vec3, tierods: float) -> dict[str, Any]:
    """A knuckle with half of a tie rod of a mass [kg]."""
    found = node.child("Knuckle")
    return {
        "knuckle": with_points(found, found.part(), [(0.5 * tierods, tierod_end)]),
        "knuckle_lower": found.vector("Location Lower"),
        "knuckle_upper": found.vector("Location Upper"),
        "tierod_knuckle": tierod_end,
    }


def tierod_mass(node: Node) -> float:
    """Of the tie rod [kg]."""
    rod = node.child("Tierod")
    rod.skip("Inertia")
    return rod.number("Mass", "kg")


def rod_of(found: Link) -> AxleRod:
    """A link that leads the tube."""
    return AxleRod(chassis_point=found.chassis, axle_point=found.axle, mirrored=found.mirrored)


def three_link_axle(node: Node) -> BeamAxle:
    """SolidThreeLinkAxle."""
    links = three_links(node)
    return beam(node, links, **three_link_guide(links))


def three_link_guide(links: Sequence[Link]) -> dict[str, Any]:
    """Triangular arm and longitudinal rods."""
    arm, rods = links[0], links[1]
    return {"arm": TriangularArm(chassis_point=arm.chassis, axle_point=arm.axle), "rods": (rod_of(rods),)}


def bell_crank_axle(node: Node) -> BeamAxle:
    """SolidBellcrankThreeLinkAxle: two tie rods of the given mass; the crank's halves of them are its own."""
    links = bell_crank_links(node)
    crank, rod = node.child("Bellcrank"), node.child("Draglink")
    pivot, end, mass = crank.vector("Location Axle"), crank.vector("Location Tierod"), tierod_mass(node)
    across = (end[0], -end[1], end[2])
    draglink = links[-1]
    hung = [(0.5 * mass, end), (0.5 * mass, across), *draglink.points(on_axle=True)]
    part = with_points(crank, crank.part(pivot), hung)
    return beam(
        node,
        links[:-1],
        **three_link_guide(links),
        **knuckle(node, node.child("Knuckle").vector("Location Tierod"), mass),
        draglink_chassis=rod.vector("Location Steering"),
        bell_crank=crank.make(BellCrank, part=part, pivot=pivot, draglink=draglink.axle, tierod=end),
        crossed_tierods=True,
    )


def solid_axle(node: Node) -> BeamAxle:
    """SolidAxle: the bell crank moves the tie rod between the knuckles along itself.

    The rod from the crank to the left knuckle lies along it. A track bar is left out but for its mass: the four links
    hold the tube sideways already, and with a fifth rod it could not roll.
    """
    links = solid_links(node)
    crank, rod = node.child("Bell Crank"), node.child("Tierod")
    pivot, end = crank.vector("Location Axle"), crank.vector("Location Tierod")
    draglink = links[2]
    crank_com = tuple(float(v) for v in np.mean([pivot, end, draglink.axle], axis=0))
    axis = np.cross(np.subtract(draglink.axle, pivot), np.subtract(end, pivot))
    part = with_points(crank, crank.part(crank_com), draglink.points(on_axle=True))  # type: ignore[arg-type]
    return beam(
        node,
        [*links[:2], *links[3:]],
        rods=tuple(rod_of(each) for each in links[:2]),
        **knuckle(node, rod.vector("Location Knuckle"), tierod_mass(node)),
        draglink_chassis=draglink.chassis,
        bell_crank=crank.make(
            BellCrank, part=part, pivot=pivot, axis=tuple((axis / np.linalg.norm(axis)).tolist()),
            draglink=draglink.axle, tierod=end,
        ),
    )  # fmt: skip


def leaf_spring_axle(node: Node) -> BeamAxle:
    """LeafspringAxle: leaves let the tube rise and roll."""
    return beam(node, (), guide="leaf-springs")


def toe_bar(node: Node) -> dict[str, Any]:
    """Knuckles with a tie rod between them, one of which a drag link moves."""
    (draglink,) = toe_bar_links(node)
    found = knuckle(node, node.child("Tierod").vector("Location Knuckle"), tierod_mass(node))
    return found | {"draglink_chassis": draglink.chassis, "draglink_knuckle": draglink.axle}


def toe_bar_leaf_spring_axle(node: Node) -> BeamAxle:
    """ToeBarLeafspringAxle."""
    return beam(node, toe_bar_links(node), **toe_bar(node), guide="leaf-springs")


def panhard(node: Node) -> dict[str, Any]:
    """A plane and a Panhard rod; arms of an anti-roll bar of length l, a width b apart, twist it by b/l per roll."""
    links = panhard_links(node)
    found: dict[str, Any] = {"guide": "plane", "rods": (rod_of(links[0]),)}
    if "Anti Roll Bar" in node:
        bar, arm = node.child("Anti Roll Bar"), links[1]
        lever = abs(arm.axle[0] - arm.chassis[0])
        if lever == 0.0:
            raise bar.place.at("Location Axle").error("must lie ahead of or behind Location Chassis, got the same x")
        ratio = (2.0 * arm.axle[1] / lever) ** 2
        found["roll_stiffness"] = ratio * bar.number("Rotational Stiffness", "N·m/rad")
        found["roll_damping"] = ratio * bar.number("Rotational Damping", "N·m·s/rad")
    return found


def panhard_axle(node: Node) -> BeamAxle:
    """RigidPanhardAxle."""
    return beam(node, panhard_links(node), **panhard(node))


def toe_bar_panhard_axle(node: Node) -> BeamAxle:
    """ToeBarRigidPanhardAxle."""
    return beam(node, [*panhard_links(node), *toe_bar_links(node)], **panhard(node), **toe_bar(node))


def de_dion_axle(node: Node, links: Sequence[Link] = (), **fields: Any) -> BeamAxle:
    """DeDionAxle: a ball on the chassis ahead, and a Watt linkage across, whose middle stays in the middle plane.

    Args:
        node: the suspension's object.
        links: others that leave mass to the tube.
        fields: what steers it.
    """
    tube, watt, sides = node.child("Axle Tube"), node.child("Watt Mechanism"), watt_links(node)
    tube.skip("Location Stabilizer")
    center = np.mean([each.axle for each in sides], axis=0)
    middle = (float(center[0]), float(center[1]), float(center[2]))
    hung = [point for each in (*sides, *links) for point in each.points(on_axle=True)]
    part = with_points(tube, tube.part(), [*hung, (watt.number("Center Link Mass", "kg"), middle)])
    ball = tube.vector("Location Connector Chassis")
    return node.make(BeamAxle, **common(node), axle_tube=part, springs=springs(node), ball=ball, watt=middle, **fields)


def toe_bar_de_dion_axle(node: Node) -> BeamAxle:
    """ToeBarDeDionAxle."""
    return de_dion_axle(node, toe_bar_links(node), **toe_bar(node))


def push_pipe_axle(node: Node, links: Sequence[Link] = (), **fields: Any) -> BeamAxle:
    """PushPipeAxle: a ball on the chassis ahead, and a Panhard rod; `links` and `fields` as of `de_dion_axle`."""
    tube, (rod,) = node.child("Axle Tube"), push_pipe_links(node)
    tube.skip("Portal Offset")  # of the gears in its hubs, for pictures
    ball = tube.vector("Location Connector Chassis")
    return beam(node, [rod, *links], ball=ball, rods=(rod_of(rod),), **fields)


def toe_bar_push_pipe_axle(node: Node) -> BeamAxle:
    """ToeBarPushPipeAxle."""
    return push_pipe_axle(node, toe_bar_links(node), **toe_bar(node))


def hendrickson(node: Node) -> BeamAxle:
    """HendricksonPRIMAXX: the housing rises and rolls as on leaf springs, each knuckle has a tie rod to the steering.

    Beams and rods are hinged on the chassis and end in balls on the housing there. Rigid as they are, they would hold
    its roll, which their rubber ends let go: they lead it along and across here, and bear no moments.
    """
    housing, cross, pin = node.child("Axle Housing"), node.child("Transverse Beam"), node.child("Knuckle")
    links = hendrickson_links(node)
    hung = [point for each in links for point in each.points(on_axle=True)]
    beam_mass, com, inertia = merged([housing.part(), cross.part()])
    rod = node.child("Tierod")
    rod.skip("Mass", "Inertia")
    return node.make(
        BeamAxle,
        **common(node),
        axle_tube=with_points(housing, of_matrix(housing, beam_mass, com, inertia), hung),
        guide="leaf-springs",
        knuckle=pin.part(),
        knuckle_lower=pin.vector("Lower Attachment Point"),
        knuckle_upper=pin.vector("Upper Attachment Point"),
        tierod_chassis=rod.vector("Location Chassis"),
        tierod_knuckle=rod.vector("Location Knuckle"),
        springs=(
            force_line(node.child("Shock Axle Housing"), "Location Axle Housing"),
            force_line(node.child("Shock Lower Beam"), "Location Lower Beam"),
        ),
    )


def three_link(node: Node) -> ThreeLink:
    """ThreeLinkIRS: the arm's inertia is given with x along it from the spindle to the ball, and y level."""
    arm = node.child("Trailing Arm")
    ball = arm.vector("Location Chassis")
    x = np.subtract(ball, arm.vector("Location Spindle"))
    x = x / np.linalg.norm(x)
    y = np.cross((0.0, 0.0, 1.0), x)
    y = y / np.linalg.norm(y)
    upper, lower = trailing_links(node)
    points = [(each.share * each.mass, each.axle) for each in (upper, lower)]
    return node.make(
        ThreeLink,
        **common(node),
        arm=with_points(arm, turned(arm, np.stack([x, y, np.cross(x, y)], axis=1)), points),
        arm_chassis=ball,
        upper_rod_chassis=upper.chassis, upper_rod_arm=upper.axle,
        lower_rod_chassis=lower.chassis, lower_rod_arm=lower.axle,
        springs=springs(node, "Location Arm"),
    )  # fmt: skip


AXLES: Final[dict[str, Callable[[Node], Suspension]]] = {
    "SolidThreeLinkAxle": three_link_axle,
    "SolidBellcrankThreeLinkAxle": bell_crank_axle,
    "SolidAxle": solid_axle,
    "LeafspringAxle": leaf_spring_axle,
    "ToeBarLeafspringAxle": toe_bar_leaf_spring_axle,
    "RigidPanhardAxle": panhard_axle,
    "ToeBarRigidPanhardAxle": toe_bar_panhard_axle,
    "ThreeLinkIRS": three_link,
    "HendricksonPRIMAXX": hendrickson,
    "DeDionAxle": de_dion_axle,
    "ToeBarDeDionAxle": toe_bar_de_dion_axle,
    "PushPipeAxle": push_pipe_axle,
    "ToeBarPushPipeAxle": toe_bar_push_pipe_axle,
}
