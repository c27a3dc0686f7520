"""The reference's rows: values, exact time derivatives, coordinates and their unwrapping."""

import numpy as np
import pytest

from simwarp.core.types import WORLD, JointType, PrescribedSpeed, RowKind, pose
from simwarp.model.builder import ModelBuilder
from simwarp.model.joint_types import ELEMENTS
from tests.reference.mechanisms import LOOP_TYPES, TREE_TYPES, random_mechanism
from tests.reference.step import ReferenceStep
from tests.reference.step_rows import matrices, quat_exp, quat_product, rotation_log
from tests.reference.step_solve import Bilateral

ALL = sorted({*TREE_TYPES, *LOOP_TYPES, JointType.DISTANCE, JointType.BUSHING, JointType.FREE})


def element(kind: JointType, seed: int) -> ModelBuilder:
    """Two bodies joined by one element of the kind (a free joint on the first body)."""
    if kind == JointType.FREE:
        return random_mechanism(2 * seed, 2, 0, laws=False, floating=True, joint_type=JointType.SPHERICAL)
    return random_mechanism(2 * seed + 1, 2, 0, laws=False, floating=True, joint_type=kind)


def moved(reference: ReferenceStep, velocity: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    bodies = velocity.reshape(-1, 6)
    return reference.x + time * bodies[:, :3], quat_product(quat_exp(time * bodies[:, 3:]), reference.rot)


@pytest.mark.parametrize("kind", ALL, ids=lambda k: k.name)
def test_elements_start_assembled(kind):
    reference = ReferenceStep(element(kind, 3), 1e-3)
    assert reference.violation() < 1e-13
    assert len(ELEMENTS[kind].rows) + len(ELEMENTS[kind].dofs) > 0


@pytest.mark.parametrize("kind", [k for k in ALL if ELEMENTS[k].rows], ids=lambda k: k.name)
def test_row_jacobian_is_the_time_derivative_far_from_assembled(kind):
    reference = ReferenceStep(element(kind, 5), 1e-3)
    rng = np.random.default_rng(0)
    reference.x, reference.rot = moved(reference, 0.4 * rng.normal(size=12), 1.0)
    reference._evaluate()
    velocity = rng.normal(size=12)
    rate = reference.rows.jacobian[: reference.rows.bilateral] @ velocity
    # a POINT_AXIS0 row takes each body at its own anchor: the violation itself has no lever as frame 0 turns
    violation = reference.rows.anchor1 - reference.rows.anchor0 - reference.rows._allowed()
    for n in range(reference.rows.bilateral):
        if reference.rows.kind[n] == int(RowKind.POINT_AXIS0):
            j = reference.rows.joint[n]
            body = reference.rows.parent[j]
            omega0 = np.zeros(3) if body < 0 else velocity.reshape(-1, 6)[body, 3:]
            rate[n] += violation[j] @ np.cross(omega0, reference.rows.axes0[j, :, reference.rows.axis0[n]])
    values = []
    for eps in (1e-5, -1e-5):
        x, rot = moved(reference, velocity, eps)
        reference.rows.evaluate(x, matrices(rot))
        values.append(reference.rows.value[: reference.rows.bilateral])
    np.testing.assert_allclose((values[0] - values[1]) / 2e-5, rate, atol=1e-8)


@pytest.mark.parametrize("kind", [k for k in ALL if ELEMENTS[k].dofs], ids=lambda k: k.name)
def test_coordinates_move_with_their_speeds(kind):
    reference = ReferenceStep(element(kind, 7), 1e-3)
    rows = Bilateral(reference.mass_matrix(), reference.rows.jacobian[: reference.rows.bilateral])
    velocity = rows.project(np.random.default_rng(1).normal(size=12), np.zeros(reference.rows.bilateral))
    q = []
    for eps in (1e-5, -1e-5):
        x, rot = moved(reference, velocity, eps)
        reference.rows.evaluate(x, matrices(rot))
        q.append(reference.rows.coordinates(reference.shaft_q, reference.joint_q))
    # at the start rotation vectors are zero or, for FREE, follow the child: there log has a Jacobian of its own
    speeds = reference.dof_jacobian @ velocity
    linear = reference.rows.linear[reference.rows.bilateral :]
    small = linear if kind == JointType.FREE else np.ones(len(speeds), bool)
    np.testing.assert_allclose(((q[0] - q[1]) / 2e-5)[small], speeds[small], atol=1e-8)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, 3.0, np.pi - 1e-3, np.pi - 1e-5, np.pi - 1e-9])
def test_log_inverts_exp(angle):
    axis = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    m = matrices(quat_exp(angle * axis[None]))[0]
    np.testing.assert_allclose(rotation_log(m), angle * axis, atol=1e-9)


def test_coordinates_stay_unwrapped_over_three_turns():
    speed = 20.0
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    wheel = builder.add_body("wheel", mass=2.0, inertia=(0.1, 0.1, 0.2), pose=pose((0.3, 0.2, 0.1), (0.1, 0.2, 0.3, 1)))
    builder.add_joint_revolute("axle", WORLD, wheel, axis=(1, 2, 3), drive=PrescribedSpeed())
    reference = ReferenceStep(builder, 1e-3)
    for _ in range(1000):
        reference.step(target_qd=[speed])
    assert reference.joint_q[0] > 3 * 2 * np.pi
    np.testing.assert_allclose(reference.joint_q, [speed], rtol=1e-9)
    np.testing.assert_allclose(reference.joint_qd, [speed], rtol=1e-12)


def test_coordinates_stay_unwrapped_beyond_half_a_turn_per_step():
    # two wheels against each other: 2 rad a step each, 4 rad relative to one another
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    one = builder.add_body("one", mass=2.0, inertia=(0.1, 0.1, 0.2))
    two = builder.add_body("two", mass=2.0, inertia=(0.1, 0.1, 0.2))
    builder.add_joint_revolute("one_axle", WORLD, one, axis=(0, 0, 1), drive=PrescribedSpeed())
    builder.add_joint_revolute("two_axle", one, two, axis=(0, 0, 1), drive=PrescribedSpeed())
    reference = ReferenceStep(builder, 1e-3)
    for _ in range(20):
        reference.step(target_qd=[2000.0, -4000.0])
    np.testing.assert_allclose(reference.joint_q, [40.0, -80.0], rtol=1e-9)


def test_universal_angles_match_their_sequence():
    # turn by a about x0, then by b about the carried y
    builder = ModelBuilder()
    body = builder.add_body("body", mass=1.0, inertia=(1, 1, 1))
    builder.add_joint_universal("cardan", WORLD, body, anchor=(0, 0, 0), axis0=(1, 0, 0), axis1=(0, 1, 0))
    reference = ReferenceStep(builder, 1e-3)
    a, b = 0.7, -1.1
    reference.rot = quat_product(quat_exp(np.array([[a, 0, 0]])), quat_exp(np.array([[0, b, 0]])))
    reference._evaluate()
    assert reference.violation() < 1e-15
    np.testing.assert_allclose(reference.rows.coordinates(reference.shaft_q, None), [a, b], atol=1e-14)
