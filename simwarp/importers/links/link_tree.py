"""Links and joints of a file become bodies, joints and shapes of a builder: what is welded together is one body."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD, Dof, JointType, Material, ModelError, Pose, ShapeType, pose as make_pose
from simwarp.geometry.assets import MassProperties
from simwarp.importers.coordinates import CoordinateKind, CoordinateMap, JointCoordinates
from simwarp.importers.imported import NamedFrame
from simwarp.importers.links.link_frames import NO_MASS, composed, moved_mass, relative, total_mass
from simwarp.importers.links.link_meshes import add_hulls
from simwarp.model.builder import ModelBuilder
from simwarp.model.topology import root_of

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class LinkShape:
    """Collision geometry of a link.

    Attributes:
        name: without the prefix.
        kind: convex, or PLANE.
        size: as `ShapeType` tells [m]; of a hull unused.
        pose: of its frame in the link's.
        hulls: corners (N, 3) of each convex part, of a HULL [m].
        material: the builder's default when None.
    """

    name: str
    kind: ShapeType
    size: tuple[float, float, float] = (1.0, 1.0, 1.0)
    pose: Pose = dataclasses.field(default_factory=make_pose)
    hulls: tuple[Array, ...] = ()
    material: Material | None = None


@dataclasses.dataclass(kw_only=True)
class Link:
    """A rigid part of a file.

    Attributes:
        name: without the prefix.
        pose: of its frame in the world as built.
        mass: in its frame; without mass where the file gives none.
        shapes: collision geometry.
        velocity: of the frame's origin in the world as built [m/s].
        omega: angular velocity in world axes as built [rad/s].
    """

    name: str
    pose: Pose
    mass: MassProperties = NO_MASS
    shapes: list[LinkShape] = dataclasses.field(default_factory=list)
    velocity: Array = dataclasses.field(default_factory=lambda: np.zeros(3))
    omega: Array = dataclasses.field(default_factory=lambda: np.zeros(3))


@dataclasses.dataclass(frozen=True, kw_only=True)
class LinkJoint:
    """A joint between two links, in world coordinates as built.

    Attributes:
        name: without the prefix.
        kind: FIXED welds; FREE names the coordinates of a floating link, whose parent is None.
        parent: name of the link, None for the world.
        child: name of the link.
        anchor: a point of it [m].
        axis: direction, of a kind that has one (of a PLANAR: the normal).
        direction: first axis in the plane, of a PLANAR; the world axis least along the normal when None.
        dofs: limits and efforts of its coordinates; passive ones where empty.
        offset: the file's coordinate as built, of a REVOLUTE or PRISMATIC [rad or m].
    """

    name: str
    kind: JointType
    parent: str | None
    child: str
    anchor: Array
    axis: Array | None = None
    direction: Array | None = None
    dofs: tuple[Dof, ...] = ()
    offset: float = 0.0


@dataclasses.dataclass
class Assembled:
    """What became of links and joints; names have the prefix.

    Attributes:
        bodies: name of a body's first link -> body.
        frames: name of every link -> its frame.
        joints: name -> joint of the builder, of all but welds.
        dofs: name -> first column of `State.joint_q`, of joints with coordinates.
        shapes: name -> shape indices.
        shapes_of: name of a link -> its shape indices.
        coordinates: of the file's joints, in the order given.
    """

    bodies: dict[str, int] = dataclasses.field(default_factory=dict)
    frames: dict[str, NamedFrame] = dataclasses.field(default_factory=dict)
    joints: dict[str, int] = dataclasses.field(default_factory=dict)
    dofs: dict[str, int] = dataclasses.field(default_factory=dict)
    shapes: dict[str, tuple[int, ...]] = dataclasses.field(default_factory=dict)
    shapes_of: dict[str, tuple[int, ...]] = dataclasses.field(default_factory=dict)
    coordinates: CoordinateMap | None = None

    @property
    def own_shapes(self) -> tuple[int, ...]:
        """Indices of all shapes."""
        return tuple(shape for shapes in self.shapes.values() for shape in shapes)


def free_name(names: set[str], name: str) -> str:
    """The name, with a number behind it where it is among `names` already, which gets it."""
    free, number = name, 1
    while free in names:
        free, number = f"{name}_{number}", number + 1
    names.add(free)
    return free


def tied_links(links: Sequence[Link], joints: Sequence[LinkJoint]) -> list[set[str]]:
    """Names of the links of each mechanism: those that joints tie together, not by way of the world."""
    found = {link.name: {link.name} for link in links}
    for joint in joints:
        if joint.parent is not None and found[joint.parent] is not found[joint.child]:
            merged = found[joint.parent] | found[joint.child]
            found |= dict.fromkeys(merged, merged)
    return list({id(names): names for names in found.values()}.values())


@dataclasses.dataclass
class WeldedGroup:
    """Links that are one body, which has the axes of the first.

    Attributes:
        head: the first link.
        members: all of them, in the order of the file.
        grounded: welded to the world.
        mass: of all, in the head's frame.
    """

    head: Link
    members: list[Link]
    grounded: bool
    mass: MassProperties

    @property
    def has_inertia(self) -> bool:
        """True if a body can be made of it."""
        return self.mass.mass > 0.0 and bool(np.linalg.eigvalsh(self.mass.inertia)[0] > 0.0)


def welded_groups(links: Sequence[Link], joints: Sequence[LinkJoint]) -> list[WeldedGroup]:
    """Links that FIXED joints weld together, in the order of the file.

    The head of a group is its first link that no weld hangs on another one.
    """
    index = {link.name: number for number, link in enumerate(links)}
    leader = list(range(len(links)))
    welds = [joint for joint in joints if joint.kind == JointType.FIXED]
    for joint in welds:
        if joint.parent is not None:
            a, b = sorted((root_of(leader, index[joint.parent]), root_of(leader, index[joint.child])))
            leader[b] = a
    grounded = {root_of(leader, index[joint.child]) for joint in welds if joint.parent is None}
    hanging = {joint.child for joint in welds if joint.parent is not None}
    members: dict[int, list[Link]] = {}
    for number, link in enumerate(links):
        members.setdefault(root_of(leader, number), []).append(link)
    groups = []
    for number, group in members.items():
        head = next((link for link in group if link.name not in hanging), group[0])
        mass = total_mass(moved_mass(link.mass, relative(head.pose, link.pose)) for link in group)
        groups.append(WeldedGroup(head, group, number in grounded, mass))
    return groups


def massless_heads(links: Sequence[Link], joints: Sequence[LinkJoint]) -> list[str]:
    """Names of the links that move, alone or with what is welded to them, without mass or without inertia, where they
    are no frames between joints: such a frame has no shape, a joint above it, and mass below.
    """
    groups = welded_groups(links, joints)
    group_of = {link.name: group for group in groups for link in group.members}
    below: dict[str, list[WeldedGroup]] = {}
    held: set[str] = set()
    for joint in joints:
        if joint.kind not in (JointType.FIXED, JointType.FREE):
            held.add(group_of[joint.child].head.name)
            if joint.parent is not None:
                below.setdefault(group_of[joint.parent].head.name, []).append(group_of[joint.child])

    def carries(group: WeldedGroup, asking: tuple[str, ...] = ()) -> bool:
        name = group.head.name
        if group.has_inertia or name in asking:
            return group.has_inertia
        shaped = any(link.shapes for link in group.members)
        under = below.get(name, [])
        frame = group.mass.mass == 0.0 and not shaped and name in held and bool(under)
        return frame and all(carries(other, (*asking, name)) for other in under)

    return [group.head.name for group in groups if not group.grounded and not carries(group)]


def floating_joints(links: Sequence[Link], joints: Sequence[LinkJoint]) -> list[LinkJoint]:
    """FREE joints, named link_floating, for the first link of everything that no joint ties to the world."""
    beside: dict[str, list[str]] = {}
    for joint in joints:
        if joint.parent is not None:
            beside.setdefault(joint.parent, []).append(joint.child)
            beside.setdefault(joint.child, []).append(joint.parent)
    reached: set[str] = set()

    def reach(name: str) -> None:
        front = [name]
        while front:
            here = front.pop()
            if here not in reached:
                reached.add(here)
                front += beside.get(here, [])

    for joint in joints:
        if joint.parent is None:
            reach(joint.child)
    made = []
    for link in links:
        if link.name not in reached:
            reach(link.name)
            made.append(
                LinkJoint(
                    name=f"{link.name}_floating", kind=JointType.FREE, parent=None, child=link.name,
                    anchor=link.pose.position,
                )
            )  # fmt: skip
    return made


@contextlib.contextmanager
def unchanged_on_error(builder: ModelBuilder) -> Iterator[None]:
    """A builder that loses what was added to it when an error passes."""
    kept = {
        name: value.copy() if isinstance(value, (list, set, dict)) else value for name, value in vars(builder).items()
    }
    try:
        yield
    except BaseException:
        vars(builder).clear()
        vars(builder).update(kept)
        raise


def assemble(
    builder: ModelBuilder, links: Sequence[Link], joints: Sequence[LinkJoint], *, prefix: str, source: str
) -> Assembled:
    """Adds bodies, then joints in the order given, then shapes. A base without mass is a part of the world; one that
    has mass is a body welded to it. Neither meets its neighbours. A link without mass between joints is a frame.

    Args:
        builder: to add to; it is as before where an error is raised.
        links: all of the file.
        joints: of these; FREE ones first where positions of the file begin with them.
        prefix: of all names.
        source: the file, for errors.

    Raises:
        ModelError: a value is not usable, a name is taken, or a joint ties a body to itself.
    """
    try:
        with unchanged_on_error(builder):
            return _Assembly(builder, links, joints, prefix).result
    except ModelError as error:
        raise ModelError(f"{source}: {error}") from None


class _Assembly:
    """One run of `assemble`."""

    def __init__(self, builder: ModelBuilder, links: Sequence[Link], joints: Sequence[LinkJoint], prefix: str) -> None:
        self.builder = builder
        self.prefix = prefix
        self.result = Assembled()
        self.groups = welded_groups(links, joints)
        self.body_of: dict[str, int] = {}
        for group in self.groups:
            self._add_body(group)
        coordinates: list[JointCoordinates] = []
        initial: list[float] = []
        poses = {link.name: link.pose for link in links}
        rates = 0
        for joint in joints:
            if joint.kind != JointType.FIXED:
                rates = self._add_joint(joint, poses[joint.child], coordinates, initial, rates)
        self.result.coordinates = CoordinateMap(
            tuple(coordinates), len(initial), rates, builder.dof_count, np.array(initial, np.float64)
        )
        for link in links:
            self._add_shapes(link)
        self._part_from_ground(joints)

    def _add_body(self, group: WeldedGroup) -> None:
        """The body of a group, or none where it is a part of the world; frames of all its links."""
        body, centre = WORLD, make_pose()
        name = self.prefix + group.head.name
        if not group.has_inertia and not group.grounded:
            centre = group.head.pose
            body = self.builder.add_massless_body(name, pose=centre)
            self.result.bodies[name] = body
        elif group.has_inertia:
            centre = composed(group.head.pose, make_pose(group.mass.centre))
            arm = centre.position - group.head.pose.position
            body = self.builder.add_body(
                name, mass=group.mass.mass, inertia=group.mass.inertia, pose=centre, strict=False,
                velocity=group.head.velocity + np.cross(group.head.omega, arm), omega=group.head.omega,
            )  # fmt: skip
            self.result.bodies[name] = body
        if group.grounded and body != WORLD:
            self.builder.add_joint_fixed(f"{name}_on_world", WORLD, body)
            # neither of them moves: rows of contacts between them would have no answer
            self.builder.exclude_collision(WORLD, body)
        for link in group.members:
            self.body_of[link.name] = body
            self.result.frames[self.prefix + link.name] = NamedFrame(body, relative(centre, link.pose))

    def _add_joint(
        self, joint: LinkJoint, child: Pose, coordinates: list[JointCoordinates], initial: list[float], rates: int
    ) -> int:
        """A joint of the builder and its coordinates; returns the rates of the file so far."""
        name = self.prefix + joint.name
        first = self.builder.dof_count
        self.result.joints[name] = self._added(name, joint)
        count = self.builder.dof_count - first
        if count == 0:
            return rates
        self.result.dofs[name] = first
        if joint.kind == JointType.FREE:
            wxyz = np.roll(child.rotation, 1).tolist()
            coordinates.append(JointCoordinates(name, CoordinateKind.FREE, len(initial), rates, first))
            initial += [*child.position.tolist(), *wxyz]
        elif joint.kind == JointType.SPHERICAL:
            x, y, z, w = (float(value) for value in child.rotation)
            turn = (x, y, z, w)
            coordinates.append(JointCoordinates(name, CoordinateKind.BALL, len(initial), rates, first, rotation=turn))
            initial += [1.0, 0.0, 0.0, 0.0]
        else:
            for local in range(count):
                place = len(initial), rates + local, first + local
                coordinates.append(JointCoordinates(name, CoordinateKind.SCALAR, *place, offset=joint.offset))
                initial.append(joint.offset)
        return rates + count

    def _added(self, name: str, joint: LinkJoint) -> int:
        builder = self.builder
        parent = WORLD if joint.parent is None else self.body_of[joint.parent]
        child = self.body_of[joint.child]
        ends: dict[str, Any] = {"parent": parent, "child": child, "anchor": joint.anchor}
        if joint.kind != JointType.FREE and parent == child:
            raise ModelError(
                f"joint '{name}': its two links must be able to move apart, but they are welded together; drop it"
            )
        dof = joint.dofs[0] if joint.dofs else Dof()
        options: Any = {field.name: getattr(dof, field.name) for field in dataclasses.fields(Dof)}
        match joint.kind:
            case JointType.FREE:
                return builder.add_joint_free(name, child, anchor=joint.anchor)
            case JointType.SPHERICAL:
                return builder.add_joint_spherical(name, **ends, dofs=joint.dofs)
            case _ if joint.axis is None:
                raise ModelError(f"joint '{name}': a {joint.kind.name} joint must have an axis, got none; give it one")
            case JointType.REVOLUTE:
                return builder.add_joint_revolute(name, **ends, axis=joint.axis, **options)
            case JointType.PRISMATIC:
                return builder.add_joint_prismatic(name, **ends, axis=joint.axis, **options)
            case JointType.CYLINDRICAL:
                return builder.add_joint_cylindrical(name, **ends, axis=joint.axis, dofs=joint.dofs)
            case JointType.PLANAR:
                return builder.add_joint_planar(
                    name, **ends, normal=joint.axis, direction=joint.direction, dofs=joint.dofs
                )
            case _:
                raise ModelError(f"joint '{name}': no reader makes a {joint.kind.name} joint of links; use the builder")

    def _part_from_ground(self, joints: Sequence[LinkJoint]) -> None:
        """Shapes of a base that is a part of the world do not meet those of its neighbours."""
        for joint in joints:
            if joint.parent is None:
                continue
            for base, other in ((joint.parent, joint.child), (joint.child, joint.parent)):
                if self.body_of[base] != WORLD or self.body_of[other] == WORLD:
                    continue
                beside = self._shapes_of_body(self.body_of[other])
                for shape in self.result.shapes_of[self.prefix + base]:
                    for neighbour in beside:
                        self.builder.exclude_shapes(shape, neighbour)

    def _shapes_of_body(self, body: int) -> list[int]:
        links = (name for name, own in self.body_of.items() if own == body)
        return [shape for name in links for shape in self.result.shapes_of[self.prefix + name]]

    def _add_shapes(self, link: Link) -> None:
        frame = self.result.frames[self.prefix + link.name]
        own: list[int] = []
        for shape in link.shapes:
            name = self.prefix + shape.name
            place = composed(frame.pose, shape.pose)
            options = {"name": name, "pose": place, "material": shape.material}
            added = self._add_shape(shape, frame.body, options)
            self.result.shapes[name] = added
            own += added
        self.result.shapes_of[self.prefix + link.name] = tuple(own)

    def _add_shape(self, shape: LinkShape, body: int, options: Any) -> tuple[int, ...]:
        if shape.kind is ShapeType.HULL:
            return add_hulls(self.builder, body, shape.hulls, **options)
        return (self.builder.add_shape_primitive(body, shape.kind, shape.size, **options),)


def frame_on(frames: Mapping[str, NamedFrame], link: str, pose: Pose) -> NamedFrame:
    """A frame at `pose` in a link's, on the body that the link is a part of."""
    base = frames[link]
    return NamedFrame(base.body, composed(base.pose, pose))
