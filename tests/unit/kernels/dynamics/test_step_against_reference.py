"""Every step of the kernels against the float64 reference, one step at a time (tolerances: side_by_side.py)."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes
from simwarp.core.types import (
    WORLD,
    Dof,
    JointType,
    PositionDrive,
    PrescribedPosition,
    PrescribedSpeed,
    VelocityMotor,
    pose,
)
from simwarp.model.builder import ModelBuilder
from tests.reference.mechanisms import (
    LOOP_TYPES,
    NAMED,
    TREE_TYPES,
    _add_element as add_element,
    _set_consistent_velocities as set_consistent_velocities,
    random_mechanism,
)
from tests.reference.step_laws import bounds_of
from tests.unit.kernels.dynamics.side_by_side import EPS, Controls, Pair, assert_same_steps, random_controls

SEEDS = range(3)


def names(value: object) -> str | None:
    return value.name if isinstance(value, JointType) else None


# ---- topologies ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMED)
def test_named_scene(name):
    builder = NAMED[name]()
    # Andrews' squeezer turns through radians in milliseconds and weighs grams
    dt, size = (1e-5, 1e-3) if name == "andrews" else (1e-3, 0.1)

    def controls(rng: np.random.Generator, step: int) -> Controls:
        targets = {"joint_target_q": np.full(builder.dof_count, 1e-4 * step)}
        return random_controls(builder, rng, size) | targets

    assert_same_steps(builder, dt=dt, steps=8, controls=controls)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", TREE_TYPES, ids=names)
@pytest.mark.sweep
def test_tree_joint(kind, seed):
    assert_same_steps(random_mechanism(seed, joint_type=kind, loops=0))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", [*LOOP_TYPES, JointType.DISTANCE, JointType.BUSHING, JointType.FIXED], ids=names)
@pytest.mark.sweep
def test_loop_element(kind, seed):
    builder = random_mechanism(seed, loop_type=kind, floating=False)
    assert_same_steps(builder)


@pytest.mark.parametrize("seed", range(8))
def test_everything_at_once(seed):
    builder = random_mechanism(seed, bounds=True, couplings=True, floating=False)
    assert_same_steps(builder)


@pytest.mark.parametrize("seed", SEEDS)
def test_floating_without_a_named_root(seed):
    assert_same_steps(random_mechanism(2 * seed + 1, floating=True))


@pytest.mark.parametrize("seed", SEEDS)
def test_coarse_step(seed):
    assert_same_steps(random_mechanism(seed, bounds=True, floating=False), dt=0.01)


@pytest.mark.parametrize("kind", TREE_TYPES, ids=names)
def test_flipped_joints(kind):
    assert_same_steps(middle_rooted(kind))


@pytest.mark.parametrize("kind", TREE_TYPES, ids=names)
def test_reactions_of_flipped_and_displaced_joints(kind):
    assert_same_reactions(middle_rooted(kind), moved=0.3)


def middle_rooted(kind: JointType) -> ModelBuilder:
    """The heaviest body is in the middle: the joints before it are walked from their child to their parent."""
    rng = np.random.default_rng(5)
    builder = ModelBuilder(gravity=(1.0, -2.0, 3.0))
    masses = (1.0, 2.0, 50.0, 2.0, 1.0)
    for k, mass in enumerate(masses):
        inertia = mass * rng.uniform(0.02, 0.03, 3)
        builder.add_body(f"b{k}", mass=mass, inertia=inertia, pose=pose((0.5 * k, 0.1 * k, 0.0), rng.normal(size=4)))
    dof = Dof(stiffness=8.0, damping=0.4, rest=0.1, armature=0.02)
    for k in range(4):
        add_joint(builder, kind, f"j{k}", k, k + 1, rng, dof)
    model = builder.finalize(1, "cpu")
    assert sorted(link.sign for link in model.tables.links) == [-1.0, -1.0, 1.0, 1.0, 1.0]
    set_consistent_velocities(builder, rng, 2.0)
    return builder


@pytest.mark.parametrize("kind", TREE_TYPES, ids=names)
def test_the_world_as_second_body(kind):
    rng = np.random.default_rng(6)
    builder = ModelBuilder(gravity=(1.0, -2.0, 3.0))
    for k in range(2):
        builder.add_body(f"b{k}", mass=1.0 + k, inertia=(0.02, 0.03, 0.04), pose=pose((0.5 * k, 0.1, 0.0)))
    add_joint(builder, kind, "ground", 0, WORLD, rng, Dof(stiffness=8.0, damping=0.4, rest=0.1))
    add_joint(builder, JointType.REVOLUTE, "next", 1, 0, rng, Dof(damping=0.1))
    set_consistent_velocities(builder, rng, 2.0)
    assert_same_steps(builder)


def add_joint(
    builder: ModelBuilder, kind: JointType, name: str, parent: int, child: int, rng: np.random.Generator, dof: Dof
) -> int:
    """A joint of any tree type between two bodies, near both, along random axes."""

    def where(body: int) -> np.ndarray:
        return np.zeros(3) if body == WORLD else builder.bodies[body].pose.position

    anchor = 0.5 * (where(parent) + where(child)) + 0.1 * rng.normal(size=3)
    axis = rng.normal(size=3)
    ends = (name, parent, child)
    t = JointType
    match kind:
        case t.REVOLUTE:
            return builder.add_joint_revolute(*ends, axis=axis, anchor=anchor, **vars(dof))
        case t.PRISMATIC:
            return builder.add_joint_prismatic(*ends, axis=axis, anchor=anchor, **vars(dof))
        case t.SPHERICAL:
            return builder.add_joint_spherical(*ends, anchor=anchor, dofs=[dof] * 3)
        case t.CYLINDRICAL:
            return builder.add_joint_cylindrical(*ends, axis=axis, anchor=anchor, dofs=[dof] * 2)
        case t.UNIVERSAL:
            other = np.cross(axis, rng.normal(size=3))
            return builder.add_joint_universal(*ends, anchor=anchor, axis0=axis, axis1=other, dofs=[dof] * 2)
        case t.PLANAR:
            return builder.add_joint_planar(*ends, normal=axis, anchor=anchor, dofs=[dof] * 3)
        case t.DISTANCE:
            apart = anchor + 0.4 * axis / np.linalg.norm(axis)
            return builder.add_spring(*ends, anchor0=anchor, anchor1=apart, **vars(dof))
        case _:
            return builder.add_joint_fixed(*ends, anchor=anchor)


def ring(kind: JointType, dof: Dof, seed: int = 0, bodies: int = 7) -> ModelBuilder:
    """Hinges in a row from the world, and one element of the given kind from the last body back to the world.

    The hinges carry a damper: with it they weigh at least as much as any other joint in the spanning tree, and
    they come first, so that it is the last element that closes the loop.
    """
    rng = np.random.default_rng(seed)
    builder = ModelBuilder(gravity=(1.0, 2.0, -5.0))
    for k in range(bodies):
        at = (0.3 * np.cos(k), 0.3 * np.sin(k), 0.1 * k)
        builder.add_body(f"b{k}", mass=1.0 + 0.3 * k, inertia=(0.02, 0.03, 0.04), pose=pose(at, rng.normal(size=4)))
        add_joint(builder, JointType.REVOLUTE, f"hinge{k}", k - 1, k, rng, Dof(damping=0.05))
    if kind in (*TREE_TYPES, JointType.DISTANCE):
        closing = add_joint(builder, kind, "closing", WORLD, bodies - 1, rng, dof)
    else:
        add_element(builder, rng, "closing", kind, WORLD, bodies - 1)
        closing = bodies
    in_tree = {link.joint for link in builder.finalize(1, "cpu").tables.links}
    assert closing not in in_tree
    set_consistent_velocities(builder, rng, 1.0)
    return builder


# ---- laws ----------------------------------------------------------------------------------------------------------

LAWS = {
    "spring": Dof(stiffness=40.0, rest=0.2, damping=1.5, preload=0.7, armature=0.05),
    "preload only": Dof(preload=2.0),
    "stiff spring": Dof(stiffness=1e5, damping=10.0, rest=0.001),
    "spring table": Dof(spring_table=((-0.5, -0.001, 0.002, 0.5), (-9.0, -0.5, 0.4, 30.0)), rest=0.0005),
    "damper table": Dof(damper_table=((-2.0, -0.1, 0.2, 2.0), (-3.0, -1.0, 0.5, 9.0))),
    "drive": Dof(drive=PositionDrive(stiffness=300.0, damping=7.0)),
    "drive over a spring": Dof(drive=PositionDrive(stiffness=300.0, damping=7.0), stiffness=20.0, damping=0.3),
    "target position": Dof(drive=PrescribedPosition()),
    "target speed": Dof(drive=PrescribedSpeed()),
    "position table": Dof(drive=PrescribedPosition(table=((0.0, 0.0025, 0.004, 1.0), (0.0, 0.001, -0.001, 0.0)))),
    "speed table": Dof(drive=PrescribedSpeed(table=((0.0, 0.0025, 0.004, 1.0), (0.0, 1.0, -1.0, 0.0)))),
    "friction": Dof(friction=0.4),
    "sticking friction": Dof(friction=400.0),
    "limit near": Dof(limit=(-0.002, 0.003)),
    # by what the rows themselves take away; more is a recovery, which tests/physics/test_initial_states.py has
    "limit violated": Dof(limit=(1e-5, 1.5)),
    "one stop": Dof(limit=(-float("inf"), -1e-5)),
    "motor": Dof(drive=VelocityMotor(effort_limit=3.0)),
    "strong motor": Dof(drive=VelocityMotor(effort_limit=1e4)),
    "bounded drive": Dof(drive=PositionDrive(stiffness=300.0, damping=7.0, effort_limit=2.0)),
    "one-sided motor": Dof(drive=VelocityMotor(effort_limit=(0.0, 3.0))),
    "uneven motor": Dof(drive=VelocityMotor(effort_limit=(-float("inf"), 1.0))),
    "uneven drive": Dof(drive=PositionDrive(stiffness=300.0, damping=7.0, effort_limit=(-0.5, 3.0))),
    "drive bounded below": Dof(drive=PositionDrive(stiffness=300.0, damping=7.0, effort_limit=(-0.5, float("inf")))),
    "bounded drive and all": Dof(
        drive=PositionDrive(stiffness=300.0, damping=7.0, effort_limit=9.0), friction=0.3, limit=(-0.01, 0.01),
        stiffness=5.0, damping=0.1, armature=0.03,
    ),
}  # fmt: skip
SINGLE_DOF = (JointType.REVOLUTE, JointType.PRISMATIC)


def law_controls(builder: ModelBuilder):
    def controls(rng: np.random.Generator, step: int) -> Controls:
        count = builder.dof_count
        return {
            "joint_force": rng.normal(size=count), "joint_target_q": 0.002 * rng.normal(size=count),
            "joint_target_qd": rng.normal(size=count),
        }  # fmt: skip

    return controls


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", SINGLE_DOF, ids=names)
@pytest.mark.sweep
def test_law_in_the_tree(kind, law):
    rng = np.random.default_rng(3)
    builder = ModelBuilder()
    for k in range(3):
        builder.add_body(f"b{k}", mass=1.0 + k, inertia=(0.02, 0.03, 0.04), pose=pose((0.4 * k, 0.1, 0.0)))
        add_joint(builder, kind, f"j{k}", k - 1, k, rng, LAWS[law] if k != 1 else Dof())
    set_consistent_velocities(builder, rng, 1.0)
    assert_same_steps(builder, controls=law_controls(builder), steps=6)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", [*SINGLE_DOF, JointType.DISTANCE], ids=names)
@pytest.mark.sweep
def test_law_on_a_loop_joint(kind, law):
    dof = LAWS[law]
    if kind == JointType.DISTANCE:  # its coordinate starts at 0.4 m
        move = 0.4
        if dof.limit is not None:
            dof = dataclasses.replace(dof, limit=(dof.limit[0] + move, dof.limit[1] + move))
        dof = dataclasses.replace(dof, rest=dof.rest + move)
    builder = ring(kind, dof)
    assert_same_steps(builder, controls=law_controls(builder), steps=6)


@pytest.mark.parametrize(
    "kind", [JointType.SPHERICAL, JointType.CYLINDRICAL, JointType.UNIVERSAL, JointType.PLANAR], ids=names
)
@pytest.mark.parametrize("law", ["spring", "friction", "limit near", "motor", "bounded drive"])
@pytest.mark.sweep
def test_law_on_a_loop_joint_of_several_coordinates(kind, law):
    builder = ring(kind, LAWS[law])
    assert_same_steps(builder, controls=law_controls(builder))


@pytest.mark.parametrize("law", ["spring", "drive", "target speed", "friction", "limit near", "motor", "bounded drive"])
def test_law_on_a_shaft(law):
    builder = ModelBuilder()
    body = builder.add_body("wheel", mass=2.0, inertia=(0.1, 0.2, 0.1), omega=(0.0, 3.0, 0.0))
    hinge = builder.add_joint_revolute("hinge", WORLD, body, axis=(0, 1, 0), damping=0.1)
    shafts = [builder.add_shaft(f"shaft{k}", inertia=0.03 * (k + 1), speed=(6.0, -1.5)[k]) for k in range(2)]
    driven = builder.add_shaft("driven", inertia=0.02, position=0.001, speed=0.4, **vars(LAWS[law]))
    builder.add_gear("mesh", hinge, shafts[0], ratio=2.0)
    # a planetary set: the carrier turns at the mean of sun and ring
    builder.add_coupling("planetary", [(shafts[0], 0.25), (shafts[1], 0.75), (driven, -1.0)])
    builder.joints[driven] = dataclasses.replace(builder.joints[driven], initial_qd=0.25 * 6.0 - 0.75 * 1.5)
    assert_same_steps(builder, controls=law_controls(builder), steps=6)


def test_couplings_of_joints():
    builder = ModelBuilder()
    poses = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.5, 0.0), (2.0, 0.0, 0.0)]
    bodies = [builder.add_body(f"b{k}", mass=1.0 + k, inertia=(0.02, 0.03, 0.04), pose=pose(p))
              for k, p in enumerate(poses)]  # fmt: skip
    pinion = builder.add_joint_revolute("pinion", WORLD, bodies[0], axis=(0, 1, 0))
    rack = builder.add_joint_prismatic("rack", WORLD, bodies[1], axis=(0, 0, 1))
    wheel = builder.add_joint_revolute("wheel", bodies[1], bodies[2], axis=(1, 0, 0), anchor=(1.0, 0.2, 0.1))
    screw = builder.add_joint_cylindrical("screw", WORLD, bodies[3], axis=(0, 1, 1))
    builder.add_rack("mesh", pinion, rack, radius=0.3)
    builder.add_gear("gear", rack, wheel, ratio=-5.0)
    builder.add_screw("thread", screw, lead=0.05)
    set_consistent_velocities(builder, np.random.default_rng(1), 1.0)
    assert_same_steps(builder, steps=8)


def test_a_coupling_offset_is_recovered_at_the_clamped_speed():
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    a, b = (builder.add_shaft(f"s{k}", inertia=0.1) for k in range(2))
    builder.add_coupling("pair", [(a, 1.0), (b, -1.0)], offset=0.5)
    pair = assert_same_steps(builder, steps=4)
    rates = pair.sim.state.joint_qd.numpy()[0]
    assert abs(rates[0] - rates[1]) == pytest.approx(
        3.0, rel=1e-5
    )  # max_depenetration_rate: 0.5 rad are far above 3 rad/s * dt


# ---- bounds --------------------------------------------------------------------------------------------------------


def slider(limit: tuple[float, float], speed: float) -> ModelBuilder:
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    body = builder.add_body("cart", mass=1.0, inertia=(1, 1, 1), velocity=(speed, 0, 0))
    builder.add_joint_prismatic("slide", WORLD, body, axis=(1, 0, 0), limit=limit)
    return builder


@pytest.mark.parametrize("speed", [-30.0, -0.5, 0.5, 30.0])
def test_narrow_limits_stop_a_body_on_the_far_side_too(speed):
    """At 30 m/s a step is wider than the gap: the stop that lies ahead acts, whichever is nearer at the start."""
    assert_same_steps(slider((-0.01, 0.012), speed), steps=3)


def test_a_distance_limit_recovers_at_the_speed_for_lengths():
    """By moving: the ball gets no speed."""
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    body = builder.add_body("ball", mass=1.0, inertia=(1, 1, 1), pose=pose((1.0, 0, 0)))
    builder.add_joint_distance("rope", WORLD, body, anchor0=(0, 0, 0), anchor1=(1, 0, 0), limit=(0.0, 0.5))
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    sim.step(2)
    assert sim.state.body_x.numpy()[0, 0, 0] == pytest.approx(1.0 - 2 * 0.6e-3, abs=2e-6)  # of 1.2e-3, in float32
    assert sim.state.body_v.numpy()[0, 0, 0] == 0.0


# ---- inputs --------------------------------------------------------------------------------------------------------


FORCES = ["body_force", "body_torque", "body_force_b", "body_torque_b"]


@pytest.mark.parametrize("names_of_inputs", [[name] for name in FORCES] + [FORCES], ids="+".join)
def test_body_forces(names_of_inputs):
    builder = random_mechanism(3, floating=True)

    def controls(rng: np.random.Generator, step: int) -> Controls:
        return {name: 20.0 * rng.normal(size=(len(builder.bodies), 3)) for name in names_of_inputs}

    assert_same_steps(builder, controls=controls)


@pytest.mark.parametrize("kind", [JointType.REVOLUTE, JointType.SPHERICAL, JointType.CYLINDRICAL, JointType.UNIVERSAL,
                                  JointType.PLANAR, JointType.DISTANCE], ids=names)  # fmt: skip
def test_joint_force_on_a_loop_joint(kind):
    """Efforts of coordinates that have no law are pushes on the two bodies."""
    assert_same_steps(ring(kind, Dof()), size=10.0)


@pytest.mark.parametrize("turned", [False, True])
def test_joint_force_on_a_free_joint(turned):
    builder = ModelBuilder()
    rotation = (0.3, -0.2, 0.5, 0.8) if turned else (0, 0, 0, 1)
    body = builder.add_body("drone", mass=2.0, inertia=(0.1, 0.2, 0.3), pose=pose((1.0, 2.0, 3.0), rotation))
    arm = builder.add_body("arm", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=pose((1.5, 2.0, 3.0)))
    builder.add_joint_free("root", body, anchor=(1.1, 1.9, 3.2))
    builder.add_joint_revolute("shoulder", body, arm, axis=(0, 1, 0), anchor=(1.2, 2.0, 3.0), stiffness=3.0)
    set_consistent_velocities(builder, np.random.default_rng(0), 1.0)
    pair = assert_same_steps(builder, size=10.0, steps=6)
    q = pair.sim.state.joint_q.numpy()[0]
    assert np.all(np.abs(q[:3] - (1.1, 1.9, 3.2)) < 0.2)  # the world position of the anchor


@pytest.mark.parametrize("seed", [4, 10])
def test_joint_force_on_a_free_joint_that_the_tree_left_out(seed):
    """Other joints tie the body to the world: its FREE coordinates are measured, and their efforts act once."""
    builder = random_mechanism(seed)
    free = [j for j, spec in enumerate(builder.joints) if spec.type == JointType.FREE]
    in_tree = {link.joint for link in builder.finalize(1, "cpu").tables.links}
    assert free
    assert not in_tree & set(free)
    assert_same_steps(builder)


@pytest.mark.parametrize("omega", [5.0, 200.0])
def test_gyroscopic_motion(omega):
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_body("top", mass=1.0, inertia=(1.0, 2.0, 2.9), omega=(0.3 * omega, omega, 0.2 * omega),
                     pose=pose((0, 0, 0), (0.1, 0.2, 0.3, 0.9)))  # fmt: skip
    # at 200 rad/s a step of 5 ms turns the body by a radian: Newton's method has to converge
    assert_same_steps(builder, dt=5e-3, steps=6)


def test_without_gyroscopic_terms_omega_stays():
    sim = sw.Simulation(scenes.dzhanibekov().finalize(1, "cpu"), 0.1, solver=sw.SolverOptions(gyroscopic=False))
    before = sim.state.body_omega.numpy()
    for _ in range(5):
        sim.step()
    np.testing.assert_allclose(sim.state.body_omega.numpy(), before, rtol=1e-6)


@pytest.mark.parametrize("ratio", [1e-3, 1e3])
def test_unequal_masses(ratio):
    """Legal, and as exact as the condition allows: a chain whose tip is a thousand times heavier or lighter."""
    # hinges: a ball joint would leave the light rods free to twist about themselves (4e-6 kg·m²), and the rounding of
    # the heavy tip's 5 N·s would spin them by eps * 5 N·s * 0.1 m / 4e-6 kg·m² = 0.01 rad/s
    builder = scenes.chain(6, tip_mass=0.5 * ratio)
    set_consistent_velocities(builder, np.random.default_rng(0), 1.0)
    assert_same_steps(builder, size=0.0, steps=6)


def test_ten_kilometres_away():
    """Positions are float64 and rows are formed from differences: nothing gets worse far away."""
    near, far = random_mechanism(1), random_mechanism(1)
    shift = np.array([8.0e3, -6.0e3, 50.0])
    for k, body in enumerate(far.bodies):
        far.bodies[k] = dataclasses.replace(body, pose=pose(body.pose.position + shift, body.pose.rotation))
    for j, joint in enumerate(far.joints):
        for side, index in (("frame0", joint.parent), ("frame1", joint.child)):
            if index == WORLD:
                frame = getattr(joint, side)
                moved = dataclasses.replace(frame, position=frame.position + shift)
                changes: Any = {side: moved}
                far.joints[j] = dataclasses.replace(far.joints[j], **changes)
    pairs = [Pair.of(near), Pair.of(far)]
    for _ in range(20):
        for pair in pairs:
            pair.step()
    a, b = (pair.sim.state.body_x.numpy()[0] for pair in pairs)
    # float64 holds 1e4 m to 2e-12 m; rows formed from such positions have errors of 1e-12 / dt m/s, below float32
    np.testing.assert_allclose(b - shift, a, atol=1e-6)
    assert max(pairs[1].differences()[key] for key in ("v", "omega")) < 1e-4


# ---- reactions -----------------------------------------------------------------------------------------------------


def reference_reactions(pair: Pair, controls: Controls) -> tuple[np.ndarray, np.ndarray]:
    """Steps; what every joint applies to its second body at anchor 1: bilateral rows and all that acts along dofs."""
    pair.feed()
    rows, n = pair.reference.rows, pair.reference.rows.bilateral
    side1, arm = rows.side1[n:].copy(), (rows.anchor1 - rows.center1).copy()
    pair.step(controls)
    reference, h = pair.reference, pair.reference.dt
    impulse = reference.dof_impulse + h * reference.prescribed_effort
    for dof, sign, size in zip(reference.box_dof, box_signs(pair), reference.box_impulse, strict=True):
        impulse[dof] += sign * size
    reactions = [reference.reaction(j) for j in range(len(rows.joints))]
    force, torque = (np.array([reaction[k] for reaction in reactions]) for k in range(2))
    for d, joint in enumerate(rows.joint[n:]):
        lin, ang = side1[d, :3], side1[d, 3:]
        force[joint] += lin * impulse[d] / h
        torque[joint] += (ang - np.cross(arm[joint], lin)) * impulse[d] / h
    return force, torque


def box_signs(pair: Pair) -> list[float]:
    """Signs of the reference's box constraints: a lower stop pushes up, an upper one down."""
    signs = []
    for dof in pair.reference.dofs:
        signs += [s for s, at in zip((1.0, -1.0), dof.limit or (-np.inf, np.inf), strict=True) if np.isfinite(at)]
        bounded = isinstance(dof.drive, VelocityMotor) or (
            isinstance(dof.drive, PositionDrive) and bool(np.isfinite(bounds_of(dof.drive)).any())
        )
        signs += [1.0] * (int(dof.friction > 0.0) + int(bounded))
    return signs


def assert_same_reactions(builder: ModelBuilder, *, push_joint: int | None = None, moved: float = 0.0) -> None:
    """The first step, which starts without any violation; impulses are unique where no row is redundant.

    `moved`: coordinates set before, so that levers that vanish as built do not.
    """
    pair = Pair.of(builder, 1e-3, joint_reactions=True)
    if moved:
        q = np.random.default_rng(2).uniform(-moved, moved, (1, builder.dof_count)).astype(np.float32)
        pair.sim.set_joint_state(None, q, pair.sim.state.joint_qd.numpy())
        pair.feed()
    reference = pair.reference
    assert reference.rank == reference.rows.bilateral + len([d for d in reference.dofs if drives_motion(d)]) + len(
        builder.couplings
    )
    condition = pair.condition()
    controls = law_controls(builder)(np.random.default_rng(0), 0)
    controls["body_force"] = 30.0 * np.random.default_rng(1).normal(size=(len(builder.bodies), 3))
    for loop_dof in pair.sim.model.tables.loop_dof:  # no row or slot carries these: `push_joint` asks for them
        if builder.dof_start(push_joint or 0) != loop_dof or push_joint is None:
            controls["joint_force"][loop_dof] = 0.0
    force, torque = reference_reactions(pair, controls)
    # a force is a difference of momenta over dt: the rounding of the velocities (1 eps k) times all masses behind it
    momentum = sum(body.mass for body in builder.bodies) * max(1.0, float(np.max(np.abs(reference.velocity))))
    allowed = EPS * condition * momentum / reference.dt
    report = pair.sim.diagnostics
    wrong = np.abs(report.joint_reaction_force.numpy()[0] - force)
    assert np.max(wrong) <= allowed, f"joint {np.unravel_index(np.argmax(wrong), wrong.shape)[0]}: {np.max(wrong)} N"
    wrong = np.abs(report.joint_reaction_torque.numpy()[0] - torque)
    assert np.max(wrong) <= allowed, f"joint {np.unravel_index(np.argmax(wrong), wrong.shape)[0]}: {np.max(wrong)} N·m"
    assert np.max(np.abs(force)) > 20.0 * allowed  # or the comparison would show nothing


def drives_motion(dof: Dof) -> bool:
    return isinstance(dof.drive, PrescribedPosition | PrescribedSpeed)


@pytest.mark.parametrize("kind", TREE_TYPES, ids=names)
@pytest.mark.parametrize("floating", [False, True])
def test_reactions_of_tree_joints(kind, floating):
    builder = random_mechanism(2, bodies=4, loops=0, joint_type=kind, bounds=True, floating=floating, mass_range=(1, 3))
    assert_same_reactions(builder)


@pytest.mark.parametrize("kind", [*LOOP_TYPES, JointType.DISTANCE, JointType.BUSHING, JointType.FIXED], ids=names)
@pytest.mark.sweep
def test_reactions_of_loop_elements(kind):
    dof = Dof(stiffness=50.0, damping=1.0) if kind == JointType.DISTANCE else Dof()
    assert_same_reactions(ring(kind, dof))


@pytest.mark.parametrize(
    "law", ["spring", "drive", "target speed", "limit violated", "friction", "motor", "bounded drive"]
)
def test_reactions_of_loop_joints_include_drives_and_limits(law):
    assert_same_reactions(ring(JointType.REVOLUTE, LAWS[law]))


def test_reactions_of_loop_joints_include_joint_force():
    builder = ring(JointType.REVOLUTE, Dof())
    assert_same_reactions(builder, push_joint=len(builder.joints) - 1)


def test_reaction_of_a_hanging_body():
    """At rest the hinge carries the weight: +m g on the body it holds."""
    builder = ModelBuilder()
    body = builder.add_body("lamp", mass=3.0, inertia=(0.1, 0.1, 0.1), pose=pose((0.5, 0.0, 2.0)))
    builder.add_joint_fixed("bracket", WORLD, body, anchor=(0.0, 0.0, 2.0))
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3, joint_reactions=True)
    sim.step()
    np.testing.assert_allclose(sim.diagnostics.joint_reaction_force.numpy()[0, 0], (0, 0, 3 * 9.81), atol=1e-4)
    # the weight pulls 0.5 m away from the anchor: torque about it is r x F = (0.5, 0, 0) x (0, 0, 29.43)
    np.testing.assert_allclose(sim.diagnostics.joint_reaction_torque.numpy()[0, 0], (0, -0.5 * 3 * 9.81, 0), atol=1e-4)
