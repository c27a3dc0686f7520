"""ModelBuilder: host-side lists of bodies, joints, couplings and shapes; `finalize` makes a Model of W worlds."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Final, Unpack

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import Meaning, NotNegative, Positive
from simwarp.core.object_repr import Readable, Row
from simwarp.core.rotation import (
    frame_along,
    frame_from_axes,
    frame_from_axis,
    quat_conjugate,
    quat_multiply,
    rotate,
    unit_vector,
)
from simwarp.core.types import (
    FLOAT32_LEAST,
    WORLD,
    Dof,
    Drive,
    FrictionRule,
    JointType,
    ModelError,
    PairRule,
    Pose,
    Quat,
    RowKind,
    Vec3,
    checked_rotation,
    finite_vector,
    formatted,
    pose as make_pose,
)
from simwarp.model.checks import (
    check_floats,
    check_link_across_axis,
    check_perpendicular,
    checked_dof,
    checked_dofs,
    checked_flag,
    checked_inertia,
    checked_member,
    checked_name,
    checked_pose,
    distance_between,
    dof_from_options,
    finite_number,
    index_within,
    whole_number,
)
from simwarp.model.effective_parameters import refuse_idle_writes
from simwarp.model.flexible_parts import FlexibleParts
from simwarp.model.joint_types import ELEMENTS
from simwarp.model.keyword_argument_types import DofOptions
from simwarp.model.mass_ratios import unsound_ratio, unsound_rod
from simwarp.model.model import Model
from simwarp.model.rules import RULES, Name, PoseField, Vector3
from simwarp.model.shapes import ShapeList
from simwarp.model.specifications import BodySpec, CouplingSpec, Frame, JointSpec, specification_rows

Array = npt.NDArray[np.float64]


WITHOUT_AXIS: Final = (JointType.FIXED, JointType.SPHERICAL, JointType.ROD, JointType.DISTANCE)
"""Joints whose frames have the world's axes."""
FLAT: Final = (JointType.POINT_ON_PLANE, JointType.OLDHAM)
"""Joints whose axis is the normal of a plane."""
ANCHORED: Final = (
    JointType.SPHERICAL, JointType.UNIVERSAL, JointType.POINT_ON_PLANE, JointType.POINT_ON_LINE, JointType.OLDHAM,
    JointType.BUSHING,
)  # fmt: skip
"""Joints whose anchor has to be given; that of others is the child's centre unless it is."""
MAX_COUPLING_TERMS: Final = 12
IDENTITY: Final = np.array([0.0, 0.0, 0.0, 1.0])


class ModelBuilder(Readable, ShapeList, FlexibleParts):
    """Collects the bodies and joints of one world; every world of a Model shares this topology.

    Poses, anchors and axes are given in world coordinates of the initial configuration [m, rad]. The frames of a
    joint coincide in that configuration, so its coordinates start at zero. The exceptions: a spring or a distance
    with limits starts at its length, a FREE joint at the pose of its frame in the world, a shaft at its `position`.
    Indices returned here are those of the arrays of Model, State and Control.

    Args:
        gravity: acceleration [m/s²], world frame.
        friction_rule: how the frictions of two surfaces combine, a `FrictionRule` or its name ("max").
        pair_rule: how groups and masks decide which shapes meet, a `PairRule` or its name ("either").

    Raises:
        ModelError: by every method: a value is not usable, a name is taken, or a body does not exist.
    """

    def __init__(
        self, gravity: Vec3 = (0.0, 0.0, -9.81), *, friction_rule: FrictionRule | str = FrictionRule.MIN,
        pair_rule: PairRule | str = PairRule.BOTH,
    ) -> None:  # fmt: skip
        super().__init__()
        self.gravity = finite_vector("ModelBuilder", "gravity", gravity, 3)
        self.friction_rule = checked_member("ModelBuilder", "friction_rule", friction_rule, FrictionRule)
        self.pair_rule = checked_member("ModelBuilder", "pair_rule", pair_rule, PairRule)
        self.bodies: list[BodySpec] = []
        self.joints: list[JointSpec] = []
        self.couplings: list[CouplingSpec] = []

    def _readable_title(self) -> str:
        empty = "" if self.bodies or self.joints or self.shapes else "empty, "
        return f": {empty}gravity {self.gravity.round(4).tolist()} m/s²"

    def _readable_rows(self) -> dict[str, Row]:
        return specification_rows(self)

    # ---- nodes -------------------------------------------------------------------------------------------------

    @RULES.arguments("body '{name}'")
    def add_body(
        self,
        name: Name,
        *,
        mass: Annotated[Positive, Meaning("kilograms, or use WORLD for what never moves")],
        inertia: Vec3 | Sequence[Sequence[float]] | Array,
        pose: PoseField = None,
        velocity: Vector3 = (0.0, 0.0, 0.0),
        omega: Vector3 = (0.0, 0.0, 0.0),
        strict: bool = True,
    ) -> int:
        """A rigid body; returns its index.

        Args:
            mass: [kg], > 0.
            inertia: [kg·m²] about the centre of mass in body axes: diagonal entries (3,) or a matrix (3, 3).
            pose: of the centre of mass in the world; identity when None.
            velocity: of the centre of mass [m/s], world frame.
            omega: [rad/s], world frame.
            strict: refuse an inertia that no distribution of mass has (a + b < c for principal moments); published
                data of vehicles sometimes break the rule, and the equations of motion do not need it.
        """
        thing = self._new_name("body", name, (body.name for body in self.bodies))
        body = checked_inertia(thing, inertia, strict=strict)
        self.bodies.append(
            BodySpec(name, mass, body, pose or make_pose(), np.array(velocity, np.float64), np.array(omega, np.float64))
        )
        return len(self.bodies) - 1

    def add_massless_body(self, name: str, *, pose: Pose | None = None, posed: bool = False) -> int:
        """A frame between joints, with no mass of its own; returns its body index.

        Two bodies are tied by several joints in a row through such frames: hinges whose axes cross make a shoulder,
        slides and a hinge a gantry. What hangs below must have mass. No shape and no joint that closes a loop
        touches it. Where axes of neighbouring joints become parallel, one of their rates is held, and the world
        gets `WorldStatus.SINGULAR`; a little `armature` on them avoids that.

        Args:
            name: unique among bodies.
            pose: of the frame in the world, best where the joints' axes meet; identity when None.
            posed: a force element writes its pose and velocities, which pictures and sensors see: no joint and no shape
                touches it, forces on it do nothing, and a step does not know it.
        """
        thing, zero = self._new_name("body", name, (body.name for body in self.bodies)), np.zeros(3)
        is_posed = checked_flag(thing, "posed", posed)
        self.bodies.append(BodySpec(name, 0.0, np.zeros((3, 3)), checked_pose(thing, pose), zero, zero, is_posed))
        return len(self.bodies) - 1

    @RULES.arguments("shaft '{name}'")
    def add_shaft(
        self, name: Name, *, inertia: Annotated[Positive, Meaning("kg·m², or couple joints directly if it has none")],
        position: Annotated[float, Meaning("radians")] = 0.0, speed: Annotated[float, Meaning("rad/s")] = 0.0,
        **options: Unpack[DofOptions],
    ) -> int:  # fmt: skip
        """A shaft: a node of one rotation, coupled to others by `add_coupling`; returns its joint index.

        Args:
            inertia: [kg·m²], > 0.
            position: initial angle [rad].
            speed: initial speed [rad/s].
            options: the fields of `Dof`.
        """
        origin, dof = Frame(np.zeros(3), IDENTITY), dof_from_options(f"shaft '{name}'", options)
        return self._append(
            JointSpec(
                name, JointType.SHAFT, WORLD, WORLD, origin, origin, (dof,), inertia=inertia, initial_q=position,
                initial_qd=speed,
            )
        )  # fmt: skip

    # ---- joints that can be eliminated ---------------------------------------------------------------------------

    def add_joint_fixed(self, name: str, parent: int, child: int, *, anchor: Vec3 | None = None) -> int:
        """No relative motion. `anchor` (default: the child's centre) is where the reaction is reported."""
        return self._add(JointType.FIXED, name, parent, child, anchor, None, ())

    def add_joint_revolute(
        self,
        name: str,
        parent: int,
        child: int,
        *,
        axis: Vec3,
        anchor: Vec3 | None = None,
        **options: Unpack[DofOptions],
    ) -> int:
        """A hinge about `axis` through `anchor`; q [rad] turns the child positively about the axis.

        Args:
            axis: direction, world frame; any length but zero.
            anchor: a point on the axis, world frame [m]; the child's centre when None.
            options: the fields of `Dof` (limit, armature, stiffness, damping, friction, drive ...).
        """
        return self._add_single(JointType.REVOLUTE, name, parent, child, anchor, axis, options)

    def add_joint_prismatic(
        self,
        name: str,
        parent: int,
        child: int,
        *,
        axis: Vec3,
        anchor: Vec3 | None = None,
        **options: Unpack[DofOptions],
    ) -> int:
        """A slide along `axis`, fixed in the parent; q [m]. Arguments as for `add_joint_revolute`."""
        return self._add_single(JointType.PRISMATIC, name, parent, child, anchor, axis, options)

    def add_joint_spherical(
        self, name: str, parent: int, child: int, *, anchor: Vec3, rotation: Quat = (0.0, 0.0, 0.0, 1.0),
        dofs: Sequence[Dof] = (),
    ) -> int:  # fmt: skip
        """A ball joint; q is the rotation vector [rad], qd the relative angular velocity, in axes of frame 0.

        Args:
            rotation: of frame 0's axes, which the parent carries, in the world as built, xyzw quaternion.
        """
        frame = checked_rotation(checked_name("joint", name), "rotation", rotation)
        return self._add(JointType.SPHERICAL, name, parent, child, anchor, None, dofs, rotation=frame)

    def add_joint_cylindrical(
        self, name: str, parent: int, child: int, *, axis: Vec3, anchor: Vec3 | None = None, dofs: Sequence[Dof] = ()
    ) -> int:
        """Slide along and turn about `axis`: q = (m, rad)."""
        return self._add(JointType.CYLINDRICAL, name, parent, child, anchor, axis, dofs)

    def add_joint_universal(
        self, name: str, parent: int, child: int, *, anchor: Vec3, axis0: Vec3, axis1: Vec3, dofs: Sequence[Dof] = ()
    ) -> int:
        """A Cardan joint: `axis0` is fixed in the parent, `axis1` (perpendicular to it) in the child; q [rad, rad]."""
        frame = frame_from_axes(checked_name("joint", name), axis0, axis1)
        return self._add(JointType.UNIVERSAL, name, parent, child, anchor, None, dofs, rotation=frame)

    def add_joint_planar(
        self, name: str, parent: int, child: int, *, normal: Vec3, direction: Vec3 | None = None,
        anchor: Vec3 | None = None, dofs: Sequence[Dof] = (),
    ) -> int:  # fmt: skip
        """Motion in the plane through `anchor` with `normal`: q = (along x, along y, about `normal`) [m, m, rad].

        x is the part of `direction` (world frame) in the plane, y = normal x x. Where `direction` is None, x is that
        part of the world axis least along `normal`.
        """
        frame = frame_from_axis(checked_name("joint", name), normal, "normal", direction)
        return self._add(JointType.PLANAR, name, parent, child, anchor, None, dofs, rotation=frame)

    def add_joint_free(self, name: str, child: int, *, anchor: Vec3 | None = None, dofs: Sequence[Dof] = ()) -> int:
        """Names the six coordinates of a floating body: q = (position of the frame in the world [m], rotation
        vector [rad]), qd = (its velocity [m/s], angular velocity [rad/s]), all in world axes.

        Args:
            anchor: origin of the frame on the body, world frame [m]; the body's centre when None.
            dofs: springs, dampers, armature and drives without an effort limit, which tie it softly to the world.

        Raises:
            ModelError: a coordinate has bounds or a prescribed motion; the body is tied to the world by joints already
                added, or floats under another FREE joint.
        """
        thing = checked_name("joint", name)
        body = self._body(thing, "child", child)
        check_floats(thing, child, self.bodies[child].name, self.joints)
        offset = np.zeros(3)
        if anchor is not None:
            offset = finite_vector(thing, "anchor", anchor, 3) - body.pose.position
        frame1 = Frame(rotate(quat_conjugate(body.pose.rotation), offset), IDENTITY)
        checked = checked_dofs(thing, JointType.FREE.name, 6, dofs)
        return self._append(
            JointSpec(name, JointType.FREE, WORLD, int(child), Frame(np.zeros(3), IDENTITY), frame1, checked)
        )

    def add_joint_elastic(
        self, name: str, parent: int, child: int, *, anchor0: Vec3, anchor1: Vec3, up: Vec3 | None = None,
        stiffness: Sequence[float] = (0.0,) * 6, damping: Sequence[float] = (0.0,) * 6, dofs: Sequence[Dof] = (),
    ) -> int:  # fmt: skip
        """An element between two bodies that stretches, shears, twists and bends, as of a rod (`add_rod` makes whole
        ones): q = (stretch along x, shear along y, along z [m], twist about x, bending about y, about z [rad]) in the
        axes halfway between its two frames; zero as built, and unchanged by any rigid motion.

        Args:
            anchor0: its end on the parent, world frame [m].
            anchor1: its end on the child, elsewhere; x points from `anchor0` to it.
            up: direction whose part across x is the z axis; when None the world's z axis, or where x is nearly
                vertical its y axis.
            stiffness: (6,) [N/m], then [N·m/rad].
            damping: (6,) [N·s/m], then [N·m·s/rad].
            dofs: six with stiffness, damping, rest and preload, in the place of stiffness and damping.

        Raises:
            ModelError: the anchors are one point, `up` is along x, both dofs and stiffness or damping are given, or an
                argument cannot be used.
        """
        thing = checked_name("joint", name)
        length = distance_between(thing, anchor0, anchor1)
        along = finite_vector(thing, "anchor1", anchor1, 3) - finite_vector(thing, "anchor0", anchor0, 3)
        frame = frame_along(thing, along, up)
        return self._add(
            JointType.ELASTIC, name, parent, child, anchor0, None, self._six_dofs(thing, stiffness, damping, dofs),
            anchor1=anchor1, rotation=frame, offset=length,
        )  # fmt: skip

    def add_loop_joint(
        self, name: str, parent: int, child: int, *, kind: JointType, frame0: Pose, frame1: Pose | None = None
    ) -> int:
        """A joint that closes a loop between bodies that other joints hold already: its rows stay rows, and its
        bodies may collide.

        Args:
            name: unique among joints.
            parent: body of frame 0, or WORLD.
            child: body of frame 1.
            kind: FIXED or SPHERICAL.
            frame0: on the parent, in the world [m].
            frame1: on the child, in the world; that of frame 0 when None. Where the two differ, the loop is open as
                built, and `Simulation.set_joint_state` or the steps close it.

        Raises:
            ModelError: it is of another kind, the name is taken, a body does not exist, or a frame is no Pose.
        """
        thing = checked_name("joint", name)
        if not isinstance(kind, JointType) or kind not in (JointType.FIXED, JointType.SPHERICAL):
            raise ModelError(
                f"{thing}: kind must be FIXED or SPHERICAL, got {formatted(kind)}; use add_joint_... instead"
            )
        first = checked_pose(thing, frame0)
        second = first if frame1 is None else checked_pose(thing, frame1)
        return self._add(
            kind, name, parent, child, first.position, None, (), anchor1=second.position, rotation=first.rotation,
            rotation1=second.rotation, closes_loop=True,
        )  # fmt: skip

    # ---- elements that only add rows ------------------------------------------------------------------------------

    def add_joint_point_on_plane(self, name: str, parent: int, child: int, *, anchor: Vec3, normal: Vec3) -> int:
        """A point of the child stays in a plane of the parent."""
        return self._add(JointType.POINT_ON_PLANE, name, parent, child, anchor, normal, ())

    def add_joint_point_on_line(self, name: str, parent: int, child: int, *, anchor: Vec3, axis: Vec3) -> int:
        """A point of the child stays on a line of the parent."""
        return self._add(JointType.POINT_ON_LINE, name, parent, child, anchor, axis, ())

    def add_joint_parallel(self, name: str, parent: int, child: int, *, axis: Vec3) -> int:
        """An axis of the child stays parallel to one of the parent."""
        return self._add(JointType.PARALLEL, name, parent, child, None, axis, ())

    def add_joint_perpendicular(self, name: str, parent: int, child: int, *, axis0: Vec3, axis1: Vec3) -> int:
        """`axis1` of the child stays perpendicular to `axis0` of the parent."""
        thing = checked_name("joint", name)
        frame_from_axes(thing, axis0, axis1)
        return self._add(
            JointType.PERPENDICULAR, name, parent, child, None, None, (),
            rotation=frame_from_axis(thing, axis0), rotation1=frame_from_axis(thing, axis1),
        )  # fmt: skip

    def add_joint_oldham(self, name: str, parent: int, child: int, *, anchor: Vec3, normal: Vec3) -> int:
        """Translation in a plane without relative rotation."""
        return self._add(JointType.OLDHAM, name, parent, child, anchor, normal, ())

    @RULES.arguments("joint '{name}'")
    def add_joint_distance(
        self, name: Name, parent: int, child: int, *, anchor0: Vec3, anchor1: Vec3,
        length: Annotated[Positive, Meaning("metres; use add_joint_spherical for length 0")] | None = None,
        limit: tuple[float, float] | None = None,
    ) -> int:  # fmt: skip
        """A massless rod between two points: its length is kept, or held within `limit` = (min, max) [m].

        Args:
            anchor0: the point of the parent, world frame.
            anchor1: the point of the child, world frame.
            length: [m]; the initial distance when None.

        Raises:
            ModelError: both `length` and `limit` are given, the ends are one point, or a value is not usable.
        """
        thing = f"joint '{name}'"
        if limit is not None and length is not None:
            raise ModelError(f"{thing}: give length (a rod) or limit (min, max), got both; drop one")
        if limit is not None:
            return self._add_line(name, parent, child, anchor0, anchor1, (Dof(limit=limit),))
        offset = distance_between(thing, anchor0, anchor1) if length is None else length
        return self._add(JointType.ROD, name, parent, child, anchor0, None, (), anchor1=anchor1, offset=offset)

    def add_joint_revolute_spherical(
        self, name: str, parent: int, child: int, *, anchor0: Vec3, axis: Vec3, anchor1: Vec3
    ) -> int:
        """A massless link: hinged to the parent at `anchor0` about `axis`, a ball at `anchor1` of the child.
        The link is perpendicular to the axis.
        """
        thing = checked_name("joint", name)
        offset = distance_between(thing, anchor0, anchor1)
        check_link_across_axis(thing, anchor0, anchor1, axis)
        return self._add(
            JointType.REVOLUTE_SPHERICAL, name, parent, child, anchor0, axis, (), anchor1=anchor1, offset=offset
        )

    def add_joint_revolute_translational(
        self, name: str, parent: int, child: int, *, anchor0: Vec3, axis: Vec3, anchor1: Vec3, direction: Vec3
    ) -> int:
        """A massless link: hinged to the parent at `anchor0` about `axis`; the child slides along the direction
        perpendicular to both `axis` and `direction`, at the initial distance along `direction`. `axis` is
        perpendicular to `direction` and to anchor1 - anchor0.
        """
        thing = checked_name("joint", name)
        check_perpendicular(thing, "axis", axis, "direction", direction)
        check_link_across_axis(thing, anchor0, anchor1, axis)
        x1 = unit_vector(thing, "direction", direction)
        rotation1 = frame_from_axes(thing, x1, np.cross(unit_vector(thing, "axis", axis), x1))
        ends = finite_vector(thing, "anchor0", anchor0, 3), finite_vector(thing, "anchor1", anchor1, 3)
        offset = float((ends[1] - ends[0]) @ x1)
        return self._add(
            JointType.REVOLUTE_TRANSLATIONAL, name, parent, child, anchor0, axis, (),
            anchor1=anchor1, rotation1=rotation1, offset=offset,
        )  # fmt: skip

    def add_spring(
        self, name: str, parent: int, child: int, *, anchor0: Vec3, anchor1: Vec3, **options: Unpack[DofOptions]
    ) -> int:
        """A translational spring-damper-actuator: its coordinate is the length [m]; `rest` defaults to the
        initial length, `joint_force` pushes the ends apart [N], `limit` are hard bump stops.

        Args:
            options: the fields of `Dof`.
        """
        thing = checked_name("spring", name)
        options.setdefault("rest", distance_between(thing, anchor0, anchor1))
        return self._add_line(name, parent, child, anchor0, anchor1, (dof_from_options(thing, options),))

    def add_bushing(
        self,
        name: str,
        parent: int,
        child: int,
        *,
        anchor: Vec3,
        rotation: Quat = (0.0, 0.0, 0.0, 1.0),
        stiffness: Sequence[float] = (0.0,) * 6,
        damping: Sequence[float] = (0.0,) * 6,
        dofs: Sequence[Dof] = (),
    ) -> int:
        """Six compliant rows along and about the axes of a frame.

        Args:
            anchor: origin of the frame, world frame [m].
            rotation: of the frame's axes in the world, xyzw quaternion.
            stiffness: (6,) along the axes [N/m], then about them [N·m/rad].
            damping: (6,) along the axes [N·s/m], then about them [N·m·s/rad].
            dofs: six of any law, in the place of stiffness and damping.

        Raises:
            ModelError: both are given, or an argument cannot be used.
        """
        thing = checked_name("bushing", name)
        six = self._six_dofs(thing, stiffness, damping, dofs)
        frame = checked_rotation(thing, "rotation", rotation)
        return self._add(JointType.BUSHING, name, parent, child, anchor, None, six, rotation=frame)

    def add_joint_relative_rotation(self, name: str, parent: int, child: int, *, axis: Vec3) -> int:
        """The rotation of the child about an axis of its own, seen from the parent: a coordinate for couplings, as
        where a shaft with joints drives a wheel that also steers. It constrains nothing.

        Its rate [rad/s] is the relative angular velocity along the axis; its angle is that rate integrated, since a
        rotation about an axis that itself turns has no other.

        Args:
            axis: direction, world frame, fixed in the child.
        """
        return self._add_single(JointType.RELATIVE_ROTATION, name, parent, child, None, axis, {})

    def add_combination(
        self, name: str, terms: Iterable[tuple[int, float] | tuple[int, int, float]], **options: Unpack[DofOptions]
    ) -> int:  # fmt: skip
        """A coordinate that is a sum of others, q = sum of coefficient x coordinate, as of a tendon that runs over
        joints with fixed lever arms; returns its joint index.

        It moves nothing of its own. Spring, damper, friction, limit, drive and `joint_force` along it act on its terms,
        each with its coefficient; stiffness and damping are implicit.

        Args:
            terms: (joint, coefficient) or (joint, local dof, coefficient), at most twelve, of revolute, prismatic,
                cylindrical, universal and planar joints and shafts [m, rad]; a combination stands for its own terms.
            options: the fields of `Dof`.
        """
        thing = checked_name("combination", name)
        dof = dof_from_options(thing, options)
        resolved = self._terms(thing, terms, "add up fewer coordinates")
        initial = [joint.initial_q for joint in self.joints for _ in joint.dofs]
        origin = Frame(np.zeros(3), IDENTITY)
        return self._append(
            JointSpec(
                name, JointType.COMBINATION, WORLD, WORLD, origin, origin, (dof,), terms=resolved,
                initial_q=sum(factor * initial[column] for column, factor in resolved),
            )
        )  # fmt: skip

    def set_drive(self, joint: int, drive: Drive | None, *, dof: int = 0) -> None:
        """Gives a coordinate that is there already another drive, or none.

        Args:
            joint: index of the joint.
            drive: in the place of the one it has.
            dof: which of the joint's coordinates.

        Raises:
            ModelError: there is no such coordinate, nothing drives it, or the drive is not usable.
        """
        spec, local = self._coordinate("set_drive", joint, dof)
        if spec.type is JointType.RELATIVE_ROTATION:
            raise ModelError(f"set_drive: joint '{spec.name}' is {spec.type.name}, which nothing drives; name another")
        thing, dofs = f"joint '{spec.name}'", list(spec.dofs)
        dofs[local] = checked_dof(thing, dataclasses.replace(dofs[local], drive=drive))
        checked_dofs(thing, spec.type.name, len(dofs), dofs)
        self.joints[joint] = dataclasses.replace(spec, dofs=tuple(dofs))

    # ---- couplings -----------------------------------------------------------------------------------------------

    @RULES.arguments("coupling '{name}'")
    def add_coupling(
        self, name: Name, terms: Iterable[tuple[int, float] | tuple[int, int, float]], *,
        offset: Annotated[float, Meaning("a number; None keeps the initial value")] | None = None,
        damping: Annotated[NotNegative, Meaning("N·m·s/rad; 0 holds it rigidly")] = 0.0,
    ) -> int:  # fmt: skip
        """One bilateral row on coordinates: sum of coefficient x q = offset (the initial value when None).

        Gears, racks, screws, belts and planetary sets are couplings: see `add_gear`, `add_rack`, `add_screw`.

        Args:
            terms: (joint, coefficient) or (joint, local dof, coefficient), at most twelve; a combination stands for
                its own terms.
            damping: of a viscous coupling, whose sum may slip [N·m·s/rad or N·s/m]; 0 holds it rigidly.

        Raises:
            ModelError: the name is taken, or the terms or a number are not usable.
        """
        thing = f"coupling '{name}'"
        if any(coupling.name == name for coupling in self.couplings):
            raise ModelError(f"{thing}: the name is taken by another coupling; choose one of its own")
        resolved = self._terms(thing, terms, "chain couplings")
        self.couplings.append(CouplingSpec(name, resolved, offset, damping))
        return len(self.couplings) - 1

    def add_gear(self, name: str, joint0: int, joint1: int, *, ratio: float) -> int:
        """Couples two shafts or hinges: q1 = ratio · q0; the ratio is negative for external teeth."""
        return self.add_coupling(name, [(joint0, ratio), (joint1, -1.0)])

    def add_rack(self, name: str, pinion: int, rack: int, *, radius: float) -> int:
        """Couples a rack to its pinion: q_rack = radius · q_pinion [m per rad]."""
        thing = checked_name("rack", name)
        self._check_kind(thing, "pinion", pinion, 0, lengths=False)
        self._check_kind(thing, "rack", rack, 0, lengths=True)
        return self.add_coupling(name, [(pinion, radius), (rack, -1.0)])

    @RULES.arguments("screw '{name}'")
    def add_screw(self, name: Name, cylindrical: int, *, lead: Annotated[float, Meaning("metres per turn")]) -> int:
        """The slide of a cylindrical joint advances `lead` [m] per turn.

        Raises:
            ModelError: the joint is not CYLINDRICAL, or `lead` is not finite.
        """
        thing = f"screw '{name}'"
        spec, _ = self._coordinate(thing, cylindrical, 0)
        if spec.type != JointType.CYLINDRICAL:
            raise ModelError(
                f"{thing}: joint must be CYLINDRICAL, got {spec.type.name} joint '{spec.name}'; "
                "use add_coupling for two joints"
            )
        return self.add_coupling(name, [(cylindrical, 0, -1.0), (cylindrical, 1, lead / (2.0 * math.pi))])

    @property
    def dof_count(self) -> int:
        """Number of joint coordinates: the second axis of `joint_q`."""
        return sum(len(ELEMENTS[joint.type].dofs) for joint in self.joints)

    def dof_start(self, joint: int) -> int:
        """First column of `joint_q` that belongs to `joint`; of the number of joints their total.

        Raises:
            ModelError: there is no such joint.
        """
        rule = f"joint must be in 0..{len(self.joints)}"
        index_within("dof_start", rule, joint, len(self.joints) + 1, "pass what add_joint_... returned")
        return sum(len(ELEMENTS[spec.type].dofs) for spec in self.joints[:joint])

    def coordinate_of(self, column: int) -> tuple[int, int]:
        """The joint and its local coordinate that a column of `joint_q` belongs to.

        Raises:
            ModelError: there is no such column.
        """
        remedy = "pass a column of joint_q, such as dof_start returns"
        left = whole_number("coordinate_of", "column", column, 0, self.dof_count - 1, remedy)
        for joint, spec in enumerate(self.joints):
            count = len(ELEMENTS[spec.type].dofs)
            if left < count:
                return joint, left
            left -= count
        raise AssertionError("the counts of the joints are those of dof_count")

    # ---- finish --------------------------------------------------------------------------------------------------

    @property
    def body_total(self) -> int:
        """Bodies added so far."""
        return len(self.bodies)

    def finalize(
        self, world_count: int, device: str | None = None, *, per_world: Iterable[str] = (),
        contact_capacity: int | None = None,
    ) -> Model:  # fmt: skip
        """The Model of `world_count` worlds on `device` ("cpu", "cuda:0").

        Args:
            device: when None the first GPU, unless torch does not see it, else the CPU.
            per_world: names of Model arrays that get a copy per world, to be randomised (`model.PARAMETERS`).
            contact_capacity: contact slots of every world; enough for most scenes when None.

        Warns:
            UserWarning: a body may have to carry another of more than 1e5 times its mass, a rod's node of 3e5.

        Raises:
            ModelError: the worlds, the device or the topology are not usable; says which and why.
        """
        model = Model.from_builder(self, world_count, device, per_world=per_world, contact_capacity=contact_capacity)
        refuse_idle_writes(model)
        meets = frozenset(self.shapes[shape].body for shape in np.nonzero(model.shapes_that_meet)[0])
        for ratio in (unsound_ratio(self, meets - {WORLD}), unsound_rod(self)):
            if ratio is not None:
                warnings.warn(f"finalize: {ratio}", stacklevel=2)
        return model

    # ---- checks --------------------------------------------------------------------------------------------------

    def _new_name(self, kind: str, name: str, taken: Iterable[str]) -> str:
        thing = checked_name(kind, name)
        if name in taken:
            raise ModelError(f"{thing}: the name is taken by another {kind}; choose one of its own")
        return thing

    def _body(self, thing: str, role: str, index: int) -> BodySpec:
        rule = f"{role} must be a body index in 0..{len(self.bodies) - 1} or WORLD"
        return self.bodies[index_within(thing, rule, index, len(self.bodies), "pass what add_body returned")]

    def _pose_of(self, thing: str, role: str, index: int) -> Pose:
        world = isinstance(index, (int, np.integer)) and index == WORLD
        return make_pose() if world else self._body(thing, role, index).pose

    def _frame(self, thing: str, role: str, body: int, anchor: Array, rotation: Array) -> Frame:
        body_pose = self._pose_of(thing, role, body)
        inverse = quat_conjugate(body_pose.rotation)
        return Frame(rotate(inverse, anchor - body_pose.position), quat_multiply(inverse, rotation))

    def _six_dofs(
        self, thing: str, stiffness: Sequence[float], damping: Sequence[float], dofs: Sequence[Dof]
    ) -> Sequence[Dof]:
        k = finite_vector(thing, "stiffness", stiffness, 6)
        d = finite_vector(thing, "damping", damping, 6)
        if isinstance(dofs, tuple) and not dofs:
            return tuple(Dof(stiffness=float(a), damping=float(b)) for a, b in zip(k, d, strict=True))
        if k.any() or d.any():
            raise ModelError(f"{thing}: dofs must stand alone, got stiffness or damping too; put them into dofs")
        return dofs

    def _add_single(
        self, kind: JointType, name: str, parent: int, child: int, anchor: Vec3 | None, axis: Vec3,
        options: Mapping[str, Any],
    ) -> int:  # fmt: skip
        return self._add(
            kind, name, parent, child, anchor, axis, (dof_from_options(checked_name("joint", name), options),)
        )

    def _add_line(self, name: str, parent: int, child: int, anchor0: Vec3, anchor1: Vec3, dofs: Sequence[Dof]) -> int:
        distance_between(checked_name("joint", name), anchor0, anchor1)
        return self._add(JointType.DISTANCE, name, parent, child, anchor0, None, dofs, anchor1=anchor1)

    def _add(
        self, kind: JointType, name: str, parent: int, child: int, anchor: Any, axis: Any,
        dofs: Sequence[Dof], *, anchor1: Vec3 | Array | None = None, rotation: Array | None = None,
        rotation1: Array | None = None, offset: float = 0.0, closes_loop: bool = False,
    ) -> int:  # fmt: skip
        thing = checked_name("joint", name)
        child_pose = self._pose_of(thing, "child", child)
        self._pose_of(thing, "parent", parent)
        if parent == child:
            raise ModelError(
                f"{thing}: parent and child must differ, got {formatted(parent)} for both; name two bodies"
            )
        centred = anchor is None and kind not in ANCHORED
        point = child_pose.position if centred else finite_vector(thing, "anchor", anchor, 3)
        point1 = point if anchor1 is None else finite_vector(thing, "anchor1", anchor1, 3)
        if rotation is None:
            unturned = kind in WITHOUT_AXIS
            rotation = IDENTITY if unturned else frame_from_axis(thing, axis, "normal" if kind in FLAT else "axis")
        checked = checked_dofs(thing, kind.name, len(ELEMENTS[kind].dofs), dofs)
        return self._append(
            JointSpec(
                name, kind, int(parent), int(child),
                self._frame(thing, "parent", parent, point, rotation),
                self._frame(thing, "child", child, point1, rotation if rotation1 is None else rotation1),
                checked, offset=offset, closes_loop=closes_loop,
            )
        )  # fmt: skip

    def _append(self, spec: JointSpec) -> int:
        self._new_name("joint", spec.name, (joint.name for joint in self.joints))
        self.joints.append(spec)
        return len(self.joints) - 1

    def _coordinate(self, thing: str, joint: Any, local: Any) -> tuple[JointSpec, int]:
        """A joint of this builder and an index of one of its coordinates."""
        rule = f"joint must be in 0..{len(self.joints) - 1}"
        spec = self.joints[index_within(thing, rule, joint, len(self.joints), "pass what add_joint_... returned")]
        count = len(ELEMENTS[spec.type].dofs)
        rule = f"an index of joint '{spec.name}', which has {count} coordinates, must be below that"
        return spec, index_within(thing, rule, local, count, "couple joints that have coordinates")

    def _terms(self, thing: str, terms: Any, remedy: str) -> tuple[tuple[int, float], ...]:
        """(public dof index, coefficient) of 1 to 12 terms; combinations are written out."""
        try:
            listed = list(terms)
        except TypeError:
            raise ModelError(
                f"{thing}: terms must be a list, got {formatted(terms)}; write [(joint, coefficient), ...]"
            ) from None
        resolved = tuple(part for term in listed for part in self._term(thing, term))
        if not 1 <= len(resolved) <= MAX_COUPLING_TERMS:
            raise ModelError(f"{thing}: needs 1 to {MAX_COUPLING_TERMS} terms, got {len(resolved)}; {remedy}")
        return resolved

    def _term(self, thing: str, term: Any) -> list[tuple[int, float]]:
        if not isinstance(term, Sequence) or isinstance(term, (str, bytes)) or len(term) not in (2, 3):
            raise ModelError(
                f"{thing}: a term must be (joint, coefficient) or (joint, local dof, coefficient), "
                f"got {formatted(term)}; "
                "pass a list of such tuples"
            )
        joint, local, coefficient = (term[0], 0, term[1]) if len(term) == 2 else term
        spec, _ = self._coordinate(thing, joint, local)
        factor = finite_number(thing, "coefficient (or ratio, radius, lead)", coefficient)
        if abs(factor) < FLOAT32_LEAST:
            raise ModelError(f"{thing}: coefficient must not be 0, got {formatted(coefficient)}; leave the term out")
        if spec.terms:
            return [(dof, factor * part) for dof, part in spec.terms]
        return [(self.dof_start(joint) + int(local), factor)]

    def _check_kind(self, thing: str, role: str, joint: int, local: int, lengths: bool) -> None:
        spec, index = self._coordinate(thing, joint, local)
        kind = ELEMENTS[spec.type].dofs[index].kind
        if (kind in (RowKind.POINT_AXIS0, RowKind.POINT_AXIS1, RowKind.DISTANCE)) != lengths:
            wanted = "a length (a prismatic joint)" if lengths else "an angle (a revolute joint or a shaft)"
            raise ModelError(
                f"{thing}: {role} must have {wanted} as coordinate, got {spec.type.name} joint '{spec.name}'; "
                "use add_coupling for anything else"
            )
