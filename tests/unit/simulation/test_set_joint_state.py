"""set_joint_state: forward kinematics, assembly of loops, velocities that obey them, masks, shapes."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import warp as wp

import simwarp as sw
from simwarp import scenes
from simwarp.core.types import WORLD, JointType, ModelError, WorldStatus, pose
from simwarp.model.builder import ModelBuilder
from tests.reference.mechanisms import TREE_TYPES, _add_element as add_element, random_mechanism
from tests.reference.step import ReferenceStep

FINE = 2e-6
"""float32 coordinates of some units: a few eps each over a chain of five joints [m, rad]."""


def reference_at(sim: sw.Simulation, builder: ModelBuilder, world: int = 0) -> ReferenceStep:
    """The reference at the poses and velocities of one world; its joint_q is measured near the simulation's."""
    reference = ReferenceStep(builder, 1e-3)
    state = sim.state
    shafts = [builder.dof_start(j) for j in reference.rows.shaft_of]
    q = state.joint_x.numpy()[world]
    reference.joint_q = q.copy()
    reference.set_state(
        state.body_x.numpy()[world], state.body_rot.numpy()[world], state.body_v.numpy()[world],
        state.body_omega.numpy()[world], q[shafts], state.joint_qd.numpy()[world, shafts],
    )  # fmt: skip
    return reference


def chain_of(kind: JointType, *, flipped: bool = False) -> ModelBuilder:
    rng = np.random.default_rng(4)
    builder = ModelBuilder()
    count = 4
    for k in range(count):
        heavy = 100.0 if flipped and k == 2 else 1.0
        builder.add_body(
            f"b{k}", mass=heavy, inertia=np.array([0.1, 0.12, 0.14]) * heavy,
            pose=pose((0.5 * k, 0.2, 0.1), rng.normal(size=4)),
        )  # fmt: skip
    if not flipped:
        add_element(builder, rng, "ground", kind, WORLD, 0)
    for k in range(count - 1):
        add_element(builder, rng, f"j{k}", kind, k, k + 1)
    return builder


def coordinates(builder: ModelBuilder, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates with a unique meaning: rotation vectors below half a turn, second Cardan angles below a quarter."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2.5, 2.5, builder.dof_count)
    for j, spec in enumerate(builder.joints):
        start = builder.dof_start(j)
        if spec.type == JointType.UNIVERSAL:
            q[start + 1] = rng.uniform(-1.2, 1.2)
        elif spec.type in (JointType.SPHERICAL, JointType.FREE):
            tail = slice(start + len(spec.dofs) - 3, start + len(spec.dofs))
            q[tail] *= 0.6
    return q.astype(np.float32), rng.normal(size=builder.dof_count).astype(np.float32)


@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize("kind", TREE_TYPES, ids=lambda kind: kind.name)
def test_forward_kinematics_of_every_tree_joint(kind, flipped):
    builder = chain_of(kind, flipped=flipped)
    sim = sw.Simulation(builder.finalize(2, "cpu"), 1e-3)
    q, qd = coordinates(builder)
    sim.set_joint_state(None, q[None].repeat(2, 0), qd[None].repeat(2, 0))
    reference = reference_at(sim, builder, 1)
    assert reference.violation() < FINE
    # the round trip: what the reference measures at those poses is what was asked for
    np.testing.assert_allclose(reference.joint_q, q, atol=FINE)
    np.testing.assert_allclose(sim.state.joint_q.numpy()[1], q, atol=FINE)
    # speeds are some units, summed over a chain of levers of some metres
    np.testing.assert_allclose(reference.joint_qd, qd, atol=2e-5)
    np.testing.assert_allclose(sim.state.joint_qd.numpy()[1], qd, atol=2e-5)
    speeds = reference.rows.jacobian[: reference.rows.bilateral] @ reference.velocity
    assert np.max(np.abs(speeds), initial=0.0) < 2e-5
    np.testing.assert_allclose(sim.state.body_q.numpy()[1, :, :3], sim.state.body_x.numpy()[1], atol=1e-6)
    assert np.all(sim.state.world_status.numpy() == 0)


def test_floating_root_with_a_name():
    builder = ModelBuilder()
    rotation = (0.3, 0.1, -0.2, 0.9)
    body = builder.add_body("torso", mass=1.0, inertia=(0.1, 0.2, 0.3), pose=pose((1.0, 2.0, 3.0), rotation))
    leg = builder.add_body("leg", mass=0.5, inertia=(0.1, 0.1, 0.1), pose=pose((1.0, 2.0, 2.5)))
    builder.add_joint_free("root", body, anchor=(1.2, 2.0, 3.0))
    builder.add_joint_revolute("hip", body, leg, axis=(0, 1, 0), anchor=(1.0, 2.0, 2.8))
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    np.testing.assert_allclose(sim.state.joint_q.numpy()[0, :3], (1.2, 2.0, 3.0), atol=1e-6)
    q, qd = coordinates(builder)
    sim.set_joint_state(None, q[None], qd[None])
    reference = reference_at(sim, builder)
    np.testing.assert_allclose(reference.joint_q, q, atol=FINE)
    np.testing.assert_allclose(reference.joint_qd, qd, atol=1e-5)
    np.testing.assert_allclose(sim.state.joint_qd.numpy()[0], qd, atol=1e-5)
    assert reference.violation() < FINE


def test_a_floating_root_without_a_name_stays():
    builder = chain_of(JointType.REVOLUTE, flipped=True)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    q, qd = coordinates(builder)
    before = sim.state.body_x.numpy()[0, 2].copy()
    sim.set_joint_state(None, q[None], qd[None])
    np.testing.assert_array_equal(sim.state.body_x.numpy()[0, 2], before)  # the heaviest is the root


@pytest.mark.parametrize("turns", [-50, -1, 1, 7, 50])
def test_turns_are_kept(turns):
    builder = ModelBuilder()
    body = builder.add_body("wheel", mass=1.0, inertia=(0.1, 0.2, 0.3))
    nut = builder.add_body("nut", mass=1.0, inertia=(0.1, 0.2, 0.3), pose=pose((1, 0, 0)))
    puck = builder.add_body("puck", mass=1.0, inertia=(0.1, 0.2, 0.3), pose=pose((2, 0, 0)))
    cross = builder.add_body("cross", mass=1.0, inertia=(0.1, 0.2, 0.3), pose=pose((3, 0, 0)))
    builder.add_joint_revolute("hinge", WORLD, body, axis=(0, 1, 0))
    builder.add_joint_cylindrical("thread", WORLD, nut, axis=(0, 0, 1))
    builder.add_joint_planar("table", WORLD, puck, normal=(0, 0, 1))
    builder.add_joint_universal("cardan", WORLD, cross, anchor=(3, 0, 0), axis0=(1, 0, 0), axis1=(0, 1, 0))
    builder.add_shaft("shaft", inertia=0.1)
    model = builder.finalize(1, "cpu")
    sim = sw.Simulation(model, 1e-3)
    q = np.zeros((1, model.dof_count), np.float32)
    angles = [
        model.dof("hinge"),
        model.dof("thread", 1),
        model.dof("table", 2),
        model.dof("cardan"),
        model.dof("shaft"),
    ]
    q[0, angles] = 0.4 + 2.0 * np.pi * turns
    sim.set_joint_state(None, q, None)
    # float32 holds 314 rad to 3e-5
    np.testing.assert_allclose(sim.state.joint_q.numpy()[0, angles], q[0, angles], atol=4e-5)
    sim.step()
    np.testing.assert_allclose(sim.state.joint_q.numpy()[0, angles], q[0, angles], atol=1e-4)


# ---- loops ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["four_bar", "andrews", "linkage", "slider_crank", "bricard"])
def test_loops_are_assembled_from_coordinates_near(name):
    builder = getattr(scenes, name)()
    model = builder.finalize(8, "cpu")
    sim = sw.Simulation(model, 1e-4)
    rng = np.random.default_rng(0)
    start = sim.state.joint_q.numpy()
    # within 0.05 rad of closed: well inside the basin of Newton's method. The links of Andrews' squeezer are short.
    q = (start + rng.uniform(-0.05, 0.05, start.shape)).astype(np.float32)
    qd = rng.normal(size=start.shape).astype(np.float32)
    sim.set_joint_state(None, q, qd)
    assert sim.state.world_status.numpy().tolist() == [0] * 8
    for world in range(8):
        reference = reference_at(sim, builder, world)
        assert reference.violation() < 1e-5
        # the velocities obey every row: to the rounding of speeds of some 10 m/s and rad/s through the loop's solve
        speeds = reference.rows.jacobian[: reference.rows.bilateral] @ reference.velocity
        scale = np.max(np.abs(reference.velocity))
        assert np.max(np.abs(speeds)) < 2e-5 * max(1.0, scale)
        np.testing.assert_allclose(sim.state.joint_q.numpy()[world], reference.joint_q, atol=FINE * 5)
        np.testing.assert_allclose(sim.state.joint_qd.numpy()[world], reference.joint_qd, atol=2e-5 * max(1.0, scale))
    # the loops move the coordinates by as much as they were off, not elsewhere
    assert np.max(np.abs(sim.state.joint_q.numpy() - start)) < 1.0


@pytest.mark.parametrize("seed", range(4))
def test_random_loops_are_assembled(seed):
    builder = random_mechanism(seed, loops=1, laws=False, floating=False)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    q = sim.state.joint_q.numpy() + np.random.default_rng(seed).uniform(-0.02, 0.02, (1, builder.dof_count))
    sim.set_joint_state(None, q.astype(np.float32), None)
    assert sim.state.world_status.numpy()[0] == 0
    assert reference_at(sim, builder).violation() < 1e-5


def test_consistent_velocities_are_kept():
    """Rates that already obey the loop come back as they are."""
    builder = scenes.four_bar()
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    q, qd = sim.state.joint_q.numpy(), sim.state.joint_qd.numpy()
    assert np.max(np.abs(qd)) > 1.0
    velocity = sim.state.body_v.numpy()
    sim.set_joint_state(None, q, qd)
    np.testing.assert_allclose(sim.state.joint_qd.numpy(), qd, atol=1e-4)  # 12 rad/s, k about 50
    np.testing.assert_allclose(sim.state.body_v.numpy(), velocity, atol=1e-4)


def test_couplings_bind_velocities():
    builder = ModelBuilder()
    a, b = (builder.add_body(f"b{k}", mass=1.0, inertia=(0.1, 0.1, 0.1)) for k in range(2))
    j0 = builder.add_joint_revolute("j0", WORLD, a, axis=(0, 0, 1))
    j1 = builder.add_joint_revolute("j1", WORLD, b, axis=(0, 0, 1))
    builder.add_gear("mesh", j0, j1, ratio=-2.0)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    sim.set_joint_state(None, [[0.0, 0.0]], [[1.0, -2.0]])
    np.testing.assert_allclose(sim.state.joint_qd.numpy()[0], (1.0, -2.0), atol=1e-6)
    sim.set_joint_state(None, [[0.0, 0.0]], [[1.0, 0.0]])
    # the nearest in the mass metric: the projection of (1, 0) on (1, -2) / sqrt(5)
    np.testing.assert_allclose(sim.state.joint_qd.numpy()[0], (0.2, -0.4), atol=1e-6)


def test_a_state_that_cannot_be_assembled_is_flagged():
    """A triangle whose third side is longer than the other two: nothing closes it."""
    builder = ModelBuilder()
    a = builder.add_body("a", mass=1.0, inertia=(0.01, 0.1, 0.1), pose=pose((0.5, 0, 0)))
    b = builder.add_body("b", mass=1.0, inertia=(0.01, 0.1, 0.1), pose=pose((1.5, 0, 0)))
    builder.add_joint_revolute("shoulder", WORLD, a, axis=(0, 1, 0), anchor=(0, 0, 0))
    builder.add_joint_revolute("elbow", a, b, axis=(0, 1, 0), anchor=(1, 0, 0))
    builder.add_joint_distance("rope", WORLD, b, anchor0=(0, 0, 5.0), anchor1=(2, 0, 0), length=2.0)
    model = builder.finalize(3, "cpu")
    sim = sw.Simulation(model, 1e-3)
    ok = scenes.four_bar()  # a control: the same call does assemble what can be
    other = sw.Simulation(ok.finalize(3, "cpu"), 1e-3)
    sim.set_joint_state([True, False, True], np.full((3, 2), 0.1), None)
    other.set_joint_state([True, False, True], other.state.joint_q.numpy(), None)
    assert sim.state.world_status.numpy().tolist() == [WorldStatus.NOT_ASSEMBLED, 0, WorldStatus.NOT_ASSEMBLED]
    assert other.state.world_status.numpy().tolist() == [0, 0, 0]
    assert np.isfinite(sim.state.body_x.numpy()).all()


def test_setting_a_state_clears_old_flags():
    builder = scenes.pendulum()
    sim = sw.Simulation(builder.finalize(2, "cpu"), 1e-3)
    sim.control.joint_force.assign([[np.nan], [0.0]])
    sim.step()
    assert sim.state.world_status.numpy().tolist() == [WorldStatus.NON_FINITE, 0]
    sim.control.clear()
    sim.set_joint_state([True, False], [[0.3], [0.0]], None)
    sim.step()
    assert sim.state.world_status.numpy().tolist() == [0, 0]


def test_setting_a_state_forgets_warm_starts():
    builder = ModelBuilder()
    body = builder.add_body("b", mass=1.0, inertia=(1, 1, 1))
    builder.add_joint_prismatic("slide", WORLD, body, axis=(0, 0, 1), friction=100.0)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-2)
    sim.step()
    assert np.any(sim.state.box_impulse.numpy() != 0.0)
    sim.set_joint_state(None, [[0.0]], None)
    assert np.all(sim.state.box_impulse.numpy() == 0.0)


# ---- masks and shapes ------------------------------------------------------------------------------------------------

CHOSEN = [True, False, True]
MASKS = {
    "numpy": lambda: np.array(CHOSEN),
    "list": lambda: CHOSEN,
    "tuple": lambda: tuple(CHOSEN),
    "torch": lambda: torch.tensor(CHOSEN),
    "torch strided": lambda: torch.tensor([CHOSEN, CHOSEN]).T[:, 0],
    "warp": lambda: wp.array(CHOSEN, dtype=wp.bool, device="cpu"),
}


@pytest.fixture
def moving():
    sim = sw.Simulation(scenes.pendulum().finalize(3, "cpu"), 1e-2)
    for _ in range(3):
        sim.step()
    return sim


@pytest.mark.parametrize("mask", MASKS.values(), ids=MASKS)
def test_every_form_of_mask(moving, mask):
    before = moving.state.joint_q.numpy().copy()
    moving.set_joint_state(mask(), np.full((3, 1), 0.5, np.float32), None)
    after = moving.state.joint_q.numpy()
    np.testing.assert_allclose(after[[0, 2], 0], 0.5, atol=1e-6)
    assert after[1, 0] == before[1, 0]
    moving.reset(mask())
    after = moving.state.joint_q.numpy()
    np.testing.assert_array_equal(after[:, 0], [0.0, before[1, 0], 0.0])


def test_no_mask_means_all(moving):
    moving.set_joint_state(None, [[0.5]] * 3, None)
    np.testing.assert_allclose(moving.state.joint_q.numpy()[:, 0], 0.5, atol=1e-6)
    moving.reset()
    np.testing.assert_array_equal(moving.state.joint_q.numpy(), np.zeros((3, 1)))


VALUES = {
    "list": lambda v: v.tolist(), "numpy float64": lambda v: v.astype(np.float64), "numpy": lambda v: v,
    "torch": torch.from_numpy, "torch strided": lambda v: torch.from_numpy(np.hstack([v, v]))[:, :1],
    "warp": lambda v: wp.array(v, dtype=wp.float32, device="cpu"),
    "warp float64": lambda v: wp.array(v, dtype=wp.float64, device="cpu"),
    "warp strided": lambda v: wp.array(np.hstack([v, v]), dtype=wp.float32, device="cpu")[:, :1],
    "torch with gradient": lambda v: torch.from_numpy(v).requires_grad_(),
}  # fmt: skip


@pytest.mark.parametrize("form", VALUES.values(), ids=VALUES)
def test_every_form_of_values(moving, form):
    q, qd = np.array([[0.1], [0.2], [0.3]], np.float32), np.array([[1.0], [2.0], [3.0]], np.float32)
    moving.set_joint_state(None, form(q), form(qd))
    np.testing.assert_allclose(moving.state.joint_q.numpy(), q, atol=1e-6)
    np.testing.assert_allclose(moving.state.joint_qd.numpy(), qd, atol=1e-6)


def test_torch_float64_values(moving):
    """The dtype that torch.from_numpy gives; NumPy's own float64 is taken too."""
    moving.set_joint_state(None, torch.full((3, 1), 0.25, dtype=torch.float64), None)
    np.testing.assert_allclose(moving.state.joint_q.numpy(), 0.25, atol=1e-6)


BAD_VALUES = {
    "too many worlds": np.zeros((4, 1)), "too many dofs": np.zeros((3, 2)), "not numbers": [["a"]] * 3,
    "ragged": [[0.0], [0.0, 1.0], [0.0]], "torch": torch.zeros(3, 2), "torch one axis": torch.zeros(3),
    "warp": wp.zeros((2, 1), dtype=wp.float32, device="cpu"),
}  # fmt: skip


@pytest.mark.parametrize("value", list(BAD_VALUES.values()), ids=list(BAD_VALUES))
def test_values_of_a_wrong_shape(moving, value):
    before = moving.state.joint_q.numpy().copy()
    with pytest.raises(ModelError, match=r"q must .*\(3, 1\)"):
        moving.set_joint_state(None, value, None)
    np.testing.assert_array_equal(moving.state.joint_q.numpy(), before)


def test_no_coordinates_means_the_present_ones(moving):
    before = moving.state.joint_q.numpy().copy()
    moving.set_joint_state(None, None, np.full((3, 1), 0.5))
    np.testing.assert_allclose(moving.state.joint_q.numpy(), before, atol=1e-6)
    np.testing.assert_allclose(moving.state.joint_qd.numpy(), 0.5, atol=1e-6)


BAD_MASKS = {
    "too short": [True, False], "two axes": np.ones((3, 1), bool), "a bool": True,
    "torch": torch.ones(4, dtype=torch.bool),
    "warp": wp.zeros(2, dtype=wp.bool, device="cpu"),
    "warp of integers": wp.zeros(3, dtype=wp.int32, device="cpu"),
    "torch of integers": torch.ones(3, dtype=torch.int64),
    "indices": [0, 2, 1],  # of the right length by chance: no list of worlds
}  # fmt: skip


@pytest.mark.parametrize("mask", BAD_MASKS.values(), ids=BAD_MASKS)
@pytest.mark.parametrize("call", ["set_joint_state", "reset"])
def test_masks_of_a_wrong_shape(moving, mask, call):
    values = (np.zeros((3, 1)), None) if call == "set_joint_state" else ()
    with pytest.raises(ModelError, match=r"world_mask must (have shape \(3,\)|be of bool)"):
        getattr(moving, call)(mask, *values)


# ---- measure --------------------------------------------------------------------------------------------------------


def test_measure_publishes_what_a_user_wrote():
    builder = chain_of(JointType.REVOLUTE)
    sim = sw.Simulation(builder.finalize(2, "cpu"), 1e-3)
    q, qd = coordinates(builder)
    sim.set_joint_state(None, q[None].repeat(2, 0), qd[None].repeat(2, 0))
    fresh = sw.Simulation(builder.finalize(2, "cpu"), 1e-3)
    for name in ("body_x", "body_rot", "body_v", "body_omega"):
        wp.copy(getattr(fresh.state, name), getattr(sim.state, name))
    fresh.measure([False, True])
    np.testing.assert_allclose(fresh.state.joint_q.numpy()[1], q, atol=FINE)
    np.testing.assert_allclose(fresh.state.joint_qd.numpy()[1], qd, atol=2e-5)
    np.testing.assert_array_equal(fresh.state.body_q.numpy()[1], sim.state.body_q.numpy()[1])
    np.testing.assert_allclose(fresh.state.joint_q.numpy()[0], 0.0, atol=1e-12)  # the other world was left as built


def test_initial_coordinates_are_those_of_the_frames():
    builder = ModelBuilder()
    body = builder.add_body("b", mass=1.0, inertia=(1, 1, 1), pose=pose((3.0, 4.0, 0.0)), velocity=(1.0, 0, 0))
    builder.add_spring("spring", WORLD, body, anchor0=(0, 0, 0), anchor1=(3.0, 4.0, 0.0), stiffness=1.0)
    builder.add_shaft("shaft", inertia=1.0, position=2.0, speed=3.0)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    np.testing.assert_allclose(sim.state.joint_q.numpy()[0], (5.0, 2.0), rtol=1e-6)
    np.testing.assert_allclose(sim.state.joint_qd.numpy()[0], (0.6, 3.0), rtol=1e-6)


def test_rates_of_a_floating_root_are_those_that_its_couplings_leave() -> None:
    """Two arms that are asked to break their coupling turn the body that carries them as well."""
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    trunk = builder.add_body("trunk", mass=2.0, inertia=(0.2, 0.3, 0.4))
    builder.add_joint_free("root", trunk, anchor=(0.1, 0.0, 0.0))
    arms = []
    for side in (-1.0, 1.0):
        arm = builder.add_body(f"arm{side:+.0f}", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=pose((0.5, 0.5 * side, 0.0)))
        hinge = builder.add_joint_revolute(
            f"hinge{side:+.0f}", trunk, arm, axis=(0.0, 1.0, 0.0), anchor=(0.2, 0.0, 0.0)
        )
        arms.append(hinge)
    builder.add_coupling("both", [(arms[0], 1.0), (arms[1], -2.0)])
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    sim.set_joint_state(None, np.zeros((1, 8)), [[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 1.0, -0.5]])
    rates, omega = sim.state.joint_qd.numpy()[0], sim.state.body_omega.numpy()[0, trunk]
    assert abs(omega[1] - 0.5) > 0.01
    np.testing.assert_allclose(rates[3:6], omega, atol=FINE)
    anchor = sim.state.body_v.numpy()[0, trunk] + np.cross(omega, (0.1, 0.0, 0.0))
    np.testing.assert_allclose(rates[:3], anchor, atol=FINE)
    np.testing.assert_allclose(rates[6], 2.0 * rates[7], atol=FINE)


def test_rates_may_be_those_of_the_state_itself():
    """They are read before they are written: the call changes nothing."""
    simulation = sw.Simulation(chain_of(JointType.REVOLUTE).finalize(world_count=2, device="cpu"), dt=1e-3)
    rates = np.random.default_rng(1).normal(size=(2, simulation.model.dof_count))
    simulation.set_joint_state(None, None, rates)
    given = simulation.state.joint_qd.numpy().copy()
    assert np.abs(given - rates).max() < FINE
    for own in (simulation.state.joint_qd, sw.to_torch(simulation.state.joint_qd)):
        simulation.set_joint_state(None, simulation.state.joint_q, own)
        assert np.abs(simulation.state.joint_qd.numpy() - given).max() < FINE


# ---- contacts -------------------------------------------------------------------------------------------------------


def touching(worlds: int = 3) -> sw.Simulation:
    """Bricks that slide on the ground, pressed into a corner with a wall."""
    builder = ModelBuilder()
    builder.add_shape_plane(material=sw.Material(friction=0.6))
    brick = builder.add_solid("brick", "box", (0.2, 0.15, 0.1), mass=2.0, pose=pose((0.0, 0.0, 0.1)))
    builder.add_joint_free("place", brick)
    builder.add_shape_box(WORLD, half=(0.1, 1.0, 1.0), pose=pose((0.301, 0.0, 1.0)))
    sim = sw.Simulation(builder.finalize(worlds, "cpu"), 2e-3, threads=1)
    sim.control.body_force[:, 0] = (5.0, 1.0, 0.0)
    return sim


def set_coordinates(sim: sw.Simulation, mask: object) -> None:
    q = np.array([0.0, 0.0, 0.0999, 0.0, 0.0, 0.02], np.float32)
    sim.set_joint_state(mask, q, np.array([0.1, 0.3, 0.0, 0.0, 0.0, 0.5], np.float32))


def write_poses(sim: sw.Simulation, mask: list[bool] | None) -> None:
    chosen = np.array([True] * 3 if mask is None else mask)
    for name, values in (
        ("body_x", (0.0, 0.0, 0.0999)), ("body_rot", (0.0, 0.0, np.sin(0.01), np.cos(0.01))),
        ("body_v", (0.1, 0.3, 0.0)), ("body_omega", (0.0, 0.0, 0.5)),
    ):  # fmt: skip
        array = getattr(sim.state, name)
        written = array.numpy().copy()
        written[chosen, 0] = values
        array.assign(written)
    sim.measure(mask)


SETTERS = [set_coordinates, write_poses]
OF_CONTACTS = ("contact_count", "contact_overflow", "penetration", "shape_contact_force", "body_contact_force")


@pytest.mark.parametrize("setter", SETTERS)
def test_worlds_that_are_set_forget_their_contacts_and_no_others_do(setter):
    sim = touching()
    sim.step(20)
    before = {name: getattr(sim.contacts, name).numpy().copy() for name in sim.contacts.NAMES}
    assert (before["contact_count"] > 0).all()
    assert (before["body_contact_force"][:, 0, 2] > 10.0).all()
    setter(sim, [False, True, False])
    for name in OF_CONTACTS:
        assert not getattr(sim.contacts, name).numpy()[1].any(), name
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(sim.contacts, name).numpy()[[0, 2]], values[[0, 2]], err_msg=name)


@pytest.mark.parametrize("setter", SETTERS)
def test_what_was_before_leaves_nothing_in_a_world_that_is_set(setter):
    """The next steps of a world that was set are those of one that was set at its start, bit by bit."""
    used, fresh = touching(), touching()
    used.step(20)
    for sim in (used, fresh):
        setter(sim, None)
        sim.step(3)
    assert (fresh.contacts.contact_count.numpy() > 0).all()
    for name in ("body_x", "body_rot", "body_v", "body_omega"):
        np.testing.assert_array_equal(getattr(used.state, name).numpy(), getattr(fresh.state, name).numpy())
    for name in OF_CONTACTS:
        np.testing.assert_array_equal(getattr(used.contacts, name).numpy(), getattr(fresh.contacts, name).numpy())
