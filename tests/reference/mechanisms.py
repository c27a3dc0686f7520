"""Random mechanisms for differential tests; the named ones are in `simwarp.scenes` and listed here."""

from __future__ import annotations

import dataclasses

import numpy as np

from simwarp import scenes
from simwarp.core.types import WORLD, Dof, JointType, PositionDrive, VelocityMotor, pose
from simwarp.model.builder import ModelBuilder
from tests.reference.step import ReferenceStep
from tests.reference.step_solve import Bilateral

NAMED = {
    f.__name__: f
    for f in (
        scenes.andrews, scenes.bricard, scenes.chain, scenes.double_pendulum, scenes.dzhanibekov, scenes.four_bar,
        scenes.linkage, scenes.pendulum, scenes.slider_crank,
    )
}  # fmt: skip

TREE_TYPES = (
    JointType.REVOLUTE, JointType.PRISMATIC, JointType.SPHERICAL, JointType.CYLINDRICAL, JointType.UNIVERSAL,
    JointType.PLANAR, JointType.FIXED,
)  # fmt: skip
LOOP_TYPES = (
    JointType.POINT_ON_PLANE, JointType.POINT_ON_LINE, JointType.PERPENDICULAR, JointType.ROD,
    JointType.REVOLUTE_SPHERICAL, JointType.REVOLUTE_TRANSLATIONAL, JointType.SPHERICAL, JointType.UNIVERSAL,
    JointType.PARALLEL, JointType.OLDHAM, JointType.REVOLUTE, JointType.PRISMATIC, JointType.CYLINDRICAL,
    JointType.PLANAR,
)  # fmt: skip


def random_mechanism(
    seed: int, bodies: int = 5, loops: int = 2, *, laws: bool = True, bounds: bool = False, couplings: bool = False,
    joint_type: JointType | None = None, loop_type: JointType | None = None, floating: bool | None = None,
    speed: float = 2.0, mass_range: tuple[float, float] = (0.1, 10.0),
) -> ModelBuilder:  # fmt: skip
    """A random tree with loop-closing rows, assembled, with initial velocities that satisfy every row.

    Args:
        seed: everything follows from it.
        bodies: in one tree, in random order of their parents.
        loops: row-only elements or joints between bodies that the tree already connects. Each keeps at least
            one degree of freedom of the whole: one that would lock the mechanism is left out.
        laws: random stiffness, damping, armature and preload on half of the degrees of freedom, one spring.
        bounds: random limits (close to the start), dry friction, velocity motors and bounded PD drives.
        couplings: one coupling of two degrees of freedom and, on a shaft, a gear.
        joint_type: of every tree joint; random when None.
        loop_type: of every loop element; random when None.
        floating: whether the root is free; random when None. A free root gets a FREE joint on even seeds.
        speed: root mean square of the velocities before they are made consistent [m/s, rad/s].
        mass_range: of log-uniform masses [kg].
    """
    rng = np.random.default_rng(seed)
    builder = ModelBuilder(gravity=rng.normal(size=3) * 5.0)
    free_root = bool(rng.integers(2)) if floating is None else floating
    _add_bodies(builder, rng, bodies, mass_range)
    for child in range(bodies):
        parent = WORLD if child == 0 else int(rng.integers(max(0, child - 3), child))
        if child == 0 and free_root:
            if seed % 2 == 0:
                builder.add_joint_free("root", 0)
            continue
        kind = joint_type if joint_type is not None else TREE_TYPES[rng.integers(len(TREE_TYPES))]
        _add_element(builder, rng, f"joint{child}", kind, parent, child, laws, bounds)
    for k in range(loops):
        _add_loop(builder, rng, f"loop{k}", loop_type)
    if laws and bodies > 1:
        _add_random_spring(builder, rng)
    if couplings:
        _add_couplings(builder, rng)
    _set_consistent_velocities(builder, rng, speed)
    return builder


def _add_bodies(builder: ModelBuilder, rng: np.random.Generator, count: int, mass_range: tuple[float, float]) -> None:
    for k in range(count):
        mass = float(np.exp(rng.uniform(*np.log(mass_range))))
        # inertia of a cloud of points: always physical
        points = rng.normal(size=(6, 3)) * rng.uniform(0.08, 0.25)
        second = mass * points.T @ points / 6.0
        inertia = np.trace(second) * np.eye(3) - second
        builder.add_body(
            f"body{k}", mass=mass, inertia=inertia, pose=pose(rng.normal(size=3) * 0.6, rng.normal(size=4))
        )


def _random_dof(rng: np.random.Generator, laws: bool, bounds: bool) -> Dof:
    values: dict = {}
    if laws and rng.random() < 0.5:
        values |= {
            "stiffness": rng.uniform(0.0, 50.0), "damping": rng.uniform(0.0, 3.0), "rest": rng.normal() * 0.3,
            "armature": rng.uniform(0.0, 0.1), "preload": rng.normal(),
        }  # fmt: skip
    if bounds:
        choice = rng.integers(5)
        if choice == 0:
            values["limit"] = (-rng.uniform(0.001, 0.05), rng.uniform(0.001, 0.05))
        elif choice == 1:
            values["friction"] = rng.uniform(0.1, 5.0)
        elif choice == 2:
            values["drive"] = VelocityMotor(effort_limit=rng.uniform(0.5, 20.0))
        elif choice == 3:
            values["drive"] = PositionDrive(stiffness=80.0, damping=4.0, effort_limit=rng.uniform(0.5, 10.0))
    return Dof(**values)


def _add_element(
    builder: ModelBuilder, rng: np.random.Generator, name: str, kind: JointType, parent: int, child: int,
    laws: bool = False, bounds: bool = False,
) -> None:  # fmt: skip
    def where(body: int) -> np.ndarray:
        return np.zeros(3) if body == WORLD else builder.bodies[body].pose.position

    anchor = 0.5 * (where(parent) + where(child)) + 0.15 * rng.normal(size=3)
    axis = rng.normal(size=3)
    other = np.cross(axis, rng.normal(size=3))
    apart = anchor + other / np.linalg.norm(other) * rng.uniform(0.2, 0.6)
    ends = (name, parent, child)

    def dofs(count: int) -> list[Dof]:
        return [_random_dof(rng, laws, bounds) for _ in range(count)]

    def single() -> dict:
        return vars(_random_dof(rng, laws, bounds))

    t = JointType
    add = {
        t.FIXED: lambda: builder.add_joint_fixed(*ends, anchor=anchor),
        t.REVOLUTE: lambda: builder.add_joint_revolute(*ends, axis=axis, anchor=anchor, **single()),
        t.PRISMATIC: lambda: builder.add_joint_prismatic(*ends, axis=axis, anchor=anchor, **single()),
        t.SPHERICAL: lambda: builder.add_joint_spherical(*ends, anchor=anchor, dofs=dofs(3)),
        t.CYLINDRICAL: lambda: builder.add_joint_cylindrical(*ends, axis=axis, anchor=anchor, dofs=dofs(2)),
        t.UNIVERSAL: lambda: builder.add_joint_universal(*ends, anchor=anchor, axis0=axis, axis1=other, dofs=dofs(2)),
        t.PLANAR: lambda: builder.add_joint_planar(*ends, normal=axis, anchor=anchor, dofs=dofs(3)),
        t.POINT_ON_PLANE: lambda: builder.add_joint_point_on_plane(*ends, anchor=anchor, normal=axis),
        t.POINT_ON_LINE: lambda: builder.add_joint_point_on_line(*ends, anchor=anchor, axis=axis),
        t.PARALLEL: lambda: builder.add_joint_parallel(*ends, axis=axis),
        t.PERPENDICULAR: lambda: builder.add_joint_perpendicular(*ends, axis0=axis, axis1=other),
        t.OLDHAM: lambda: builder.add_joint_oldham(*ends, anchor=anchor, normal=axis),
        t.ROD: lambda: builder.add_joint_distance(*ends, anchor0=anchor, anchor1=apart),
        t.DISTANCE: lambda: builder.add_spring(*ends, anchor0=anchor, anchor1=apart, **single()),
        t.REVOLUTE_SPHERICAL: lambda: builder.add_joint_revolute_spherical(
            *ends, anchor0=anchor, axis=axis, anchor1=apart
        ),
        t.REVOLUTE_TRANSLATIONAL: lambda: builder.add_joint_revolute_translational(
            *ends, anchor0=anchor, axis=axis, anchor1=apart, direction=other
        ),
        t.BUSHING: lambda: builder.add_bushing(
            *ends, anchor=anchor, rotation=rng.normal(size=4), stiffness=rng.uniform(5.0, 500.0, 6).tolist(),
            damping=rng.uniform(0.0, 5.0, 6).tolist(),
        ),
    }  # fmt: skip
    add[kind]()


def _healthy(builder: ModelBuilder) -> bool:
    """Whether something can still move and no constraint is nearly dependent (that would amplify rounding)."""
    reference = ReferenceStep(builder, 1e-3)
    c = reference.coupling_coefficients @ reference.dof_jacobian
    rows = Bilateral(reference.mass_matrix(), np.vstack([reference.rows.jacobian[: reference.rows.bilateral], c]))
    return rows.rank < reference.rows.width and (rows.rank == 0 or rows.s[-1] > 0.02)


def _add_loop(builder: ModelBuilder, rng: np.random.Generator, name: str, kind: JointType | None) -> None:
    """A loop element of the given kind (or a random one) that leaves the mechanism healthy, if 12 tries find one."""
    for _ in range(12):
        child = int(rng.integers(len(builder.bodies)))
        parent = int(rng.integers(-1, len(builder.bodies)))
        if parent == child:
            continue
        chosen = kind if kind is not None else LOOP_TYPES[rng.integers(len(LOOP_TYPES))]
        _add_element(builder, rng, name, chosen, parent, child)
        if _healthy(builder):
            return
        builder.joints.pop()


def _add_random_spring(builder: ModelBuilder, rng: np.random.Generator) -> None:
    child = len(builder.bodies) - 1
    at = builder.bodies[child].pose.position
    builder.add_spring(
        "spring", WORLD, child, anchor0=rng.normal(size=3), anchor1=at + 0.1 * rng.normal(size=3),
        stiffness=rng.uniform(5.0, 100.0), damping=rng.uniform(0.0, 2.0), preload=rng.normal(),
    )  # fmt: skip


def _add_couplings(builder: ModelBuilder, rng: np.random.Generator) -> None:
    single = (JointType.REVOLUTE, JointType.PRISMATIC, JointType.CYLINDRICAL)
    usable = [k for k, joint in enumerate(builder.joints) if joint.type in single]
    if not usable:
        return
    shaft = builder.add_shaft("shaft", inertia=rng.uniform(0.01, 0.5), position=rng.normal(), damping=0.1)
    builder.add_coupling("shaft_gear", [(usable[0], 2.5), (shaft, -1.0)])
    if len(usable) > 2:
        builder.add_coupling("pair", [(usable[1], 1.0), (usable[2], 0, -0.7)])
        if not _healthy(builder):
            builder.couplings.pop()


def _set_consistent_velocities(builder: ModelBuilder, rng: np.random.Generator, speed: float) -> None:
    reference = ReferenceStep(builder, 1e-3)
    jacobian = np.vstack(
        [reference.rows.jacobian[: reference.rows.bilateral], reference.coupling_coefficients @ reference.dof_jacobian]
    )
    wished = speed * rng.normal(size=reference.rows.width)
    wished = Bilateral(reference.mass_matrix(), jacobian).project(wished, np.zeros(len(jacobian)))
    reference.set_velocity(wished)
    for k, spec in enumerate(builder.bodies):
        builder.bodies[k] = dataclasses.replace(spec, velocity=reference.v[k], omega=reference.omega[k])
    for j, k in reference.rows.shaft_of.items():
        builder.joints[j] = dataclasses.replace(builder.joints[j], initial_qd=float(reference.shaft_qd[k]))
