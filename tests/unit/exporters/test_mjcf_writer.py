"""Models written as MJCF: MuJoCo C has the same masses, poses, accelerations, pairs, ground and stance."""

from __future__ import annotations

from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes
from simwarp.actuators import Activation, Actuators, ActuatorSpec, SitePull, dc_motor, pd_actuator
from simwarp.core.files import FileError
from simwarp.exporters import mjcf_of, save_mjcf
from simwarp.exporters.mujoco_world import BodyState, Inputs, MujocoWorld
from simwarp.model.model import meeting_pairs
from tests.unit.actuators.cart_and_wheel import bodies, start
from tests.unit.exporters.written_models import BUILDERS, Both, servo_hexapod, zoo

SEEDS = (0, 1, 2)


@pytest.fixture(scope="module", params=BUILDERS)
def both(request):
    return Both(BUILDERS[request.param](), dt=1e-5)


def test_masses_and_inertias(both):
    masses, inertias = both.model.body_mass.numpy()[0], both.model.body_inertia_b.numpy()[0]
    assert both.theirs.nbody == len(both.bodies) + 1
    for own, other in both.bodies:
        assert both.theirs.body_mass[other] == pytest.approx(float(masses[own]), rel=1e-12)
        numbers = np.zeros(9)
        mujoco.mju_quat2Mat(numbers, both.theirs.body_iquat[other])
        turn = numbers.reshape(3, 3)
        inertia = turn @ np.diag(both.theirs.body_inertia[other]) @ turn.T
        # eigenvalues of float32 entries, of which the text holds all digits
        np.testing.assert_allclose(inertia, inertias[own], rtol=0.0, atol=1e-6 * np.abs(inertias[own]).max())


def test_places_of_all_bodies_at_random_coordinates(both):
    for seed in SEEDS:
        both.set_random(seed)
        place, turned = both.pose_errors()
        assert place < 2e-6  # coordinates are set in float32
        assert turned < 2e-6


def test_accelerations_at_random_coordinates_and_rates(both):
    both.theirs.dof_frictionloss[:] = 0.0  # soft there: only near Coulomb's law
    both.model.joint_friction[...] = 0.0
    rng = np.random.default_rng(3)
    for seed in SEEDS:
        both.set_random(seed, rate=2.0)
        effort = rng.normal(size=both.model.dof_count).astype(np.float32)
        effort[: 6 if any(joint.kind == "free" and joint.dof == 0 for joint in both.mjcf.joints) else 0] = 0.0
        pairs = [(joint.dof, both.theirs.joint(joint.name).dofadr[0]) for joint in both.mjcf.joints
                 if joint.kind in ("hinge", "slide")]  # fmt: skip
        both.data.qfrc_applied[:] = 0.0
        single = np.zeros_like(effort)
        for dof, theirs in pairs:
            both.data.qfrc_applied[theirs] = single[dof] = effort[dof]
        both.sim.control.joint_force[0] = single
        mujoco.mj_forward(both.theirs, both.data)
        both.sim.step()
        found = both.sim.diagnostics.joint_qdd.numpy()[0]
        columns, theirs = map(list, zip(*pairs, strict=True))
        expected = both.data.qacc[theirs]
        # a step of 1e-5 s: what turns moves by 1e-5 of itself in it, and float32 solves have 1e-6
        assert np.abs(found[columns] - expected).max() < 2e-4 * max(1.0, np.abs(expected).max())
        assert np.abs(expected).max() > 1.0


def test_what_stands_in_the_tree_behind_massless_frames(both):
    names = {both.theirs.body(other).name for _, other in both.bodies}
    assert names == {name for name, heavy in zip(both.model.body_names, both.model.has_mass, strict=True) if heavy}


@pytest.mark.parametrize("build", [scenes.ant, servo_hexapod, zoo])
def test_a_state_goes_over_and_comes_back(build):
    both = Both(build())
    both.set_random(4)
    world = MujocoWorld(both.model, both.mjcf)
    state = both.sim.state
    names = ("body_x", "body_rot", "body_v", "body_omega", "joint_x", "joint_qd")
    world.set_state(BodyState(*(getattr(state, name).numpy()[0].astype(np.float64) for name in names)))
    np.testing.assert_allclose(world.data.qpos, both.data.qpos, atol=1e-9)
    np.testing.assert_allclose(world.data.qvel, both.data.qvel, atol=1e-6)  # rates are float32 here
    back = world.state()
    np.testing.assert_allclose(back.x, state.body_x.numpy()[0], atol=2e-6)
    np.testing.assert_allclose(np.abs((back.rotation * state.body_rot.numpy()[0]).sum(axis=1)), 1.0, atol=1e-9)
    np.testing.assert_allclose(back.v, state.body_v.numpy()[0], atol=2e-5)  # of rates up to 3 over some links
    np.testing.assert_allclose(back.omega, state.body_omega.numpy()[0], atol=2e-5)


def test_drives_pull_as_ours_do():
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    drives = {"held": sw.PositionDrive(stiffness=8.0, damping=0.5, effort_limit=(-0.7, 2.0)),
              "turned": sw.PositionDrive(stiffness=0.0, damping=3.0)}  # fmt: skip
    for index, (name, drive) in enumerate(drives.items()):
        body = builder.add_body(name, mass=1.0, inertia=(0.3, 0.3, 0.3), pose=sw.pose((0, index, 0)))
        builder.add_joint_revolute(name, sw.WORLD, body, axis=(0, 0, 1), drive=drive)
    both = Both(builder, dt=1e-3)
    world = MujocoWorld(both.model, both.mjcf)
    targets = np.array([[0.4, 0.0], [0.3, 0.8]], np.float32)
    both.sim.control.joint_target_q[0], both.sim.control.joint_target_qd[0] = targets
    zeros = np.zeros((2, 3))
    inputs = Inputs(targets[0], targets[1], np.zeros(2), zeros, zeros)
    for _ in range(300):
        both.sim.step()
        world.step(inputs)
    # of first order in a step of 1 ms, which takes stiffness implicitly in one of them
    np.testing.assert_allclose(both.sim.state.joint_x.numpy()[0], world.data.qpos, atol=2e-3)
    assert abs(world.data.qpos[0]) > 0.05 < abs(world.data.qpos[1])
    assert both.theirs.actuator_forcerange[0] == pytest.approx((-0.7, 2.0))


def test_a_hexapod_stands_as_it_does_here():
    both = Both(servo_hexapod(), dt=2e-3)
    world = MujocoWorld(both.model, both.mjcf)
    count = both.model.dof_count
    zeros = np.zeros((both.model.body_count, 3))
    for _ in range(1000):
        both.sim.step()
        world.step(Inputs(np.zeros(count), np.zeros(count), np.zeros(count), zeros, zeros))
    mine, theirs = both.sim.state, world.state()
    # MuJoCo's contacts give way by some tenths of a millimetre, where ours are rigid
    np.testing.assert_allclose(theirs.x[0], mine.body_x.numpy()[0, 0], atol=1.5e-3)
    np.testing.assert_allclose(theirs.q, mine.joint_x.numpy()[0], atol=0.02)
    bodies, shapes = np.zeros((both.model.body_count, 3)), np.zeros((both.model.shape_count, 3))
    world.add_contact_forces(bodies, shapes)
    weight = float(both.model.body_mass.numpy().sum()) * 9.81
    assert bodies[:, 2].sum() == pytest.approx(weight, rel=0.01)
    floor = both.model.shape_names.index("floor")
    assert shapes[floor, 2] == pytest.approx(-weight, rel=0.01)
    feet = [index for index, name in enumerate(both.model.shape_names) if name.startswith("foot")]
    assert shapes[feet, 2].sum() == pytest.approx(weight, rel=0.01)
    ours = both.sim.contacts.body_contact_force.numpy()[0]
    np.testing.assert_allclose(bodies[:, 2], ours[:, 2], atol=0.1 * weight)  # six feet: how they share it is open


def pairs_of(mjcf):
    """Name pairs of the file with their attributes."""
    return {
        frozenset((pair.get("geom1"), pair.get("geom2"))): pair
        for pair in ElementTree.fromstring(mjcf.text).iterfind("contact/*")
    }


def test_pairs_and_their_friction():
    builder = sw.ModelBuilder(friction_rule="mean")
    rough, smooth = sw.Material(friction=1.0, rolling_friction=0.02), sw.Material(friction=0.2, spinning_friction=0.1)
    builder.add_shape_plane(material=rough, name="ground")
    high = sw.Material(friction=0.05, priority=3)
    for index, material in enumerate((smooth, high, rough)):
        builder.add_solid(f"ball{index}", "sphere", 0.1, mass=1.0, pose=sw.pose((index, 0, 0.1)), material=material)
    builder.add_shape_pair(1, 3, material=sw.Material(friction=0.33))
    builder.exclude_shapes(1, 2)
    model = builder.finalize(world_count=1, device="cpu")
    found = pairs_of(mjcf_of(model))
    names = model.shape_names
    assert set(found) == {frozenset((names[a], names[b])) for a, b in meeting_pairs(builder)}

    def friction(a, b):
        pair = found[frozenset((a, b))]
        values = [float(word) for word in pair.get("friction").split()]
        return int(pair.get("condim")), [values[0], values[2], values[3]]

    assert friction("ground", "ball0") == (6, pytest.approx([0.6, 0.05, 0.01], rel=1e-6))
    assert friction("ground", "ball1") == (3, pytest.approx([0.05, 0.0, 0.0], rel=1e-6))  # priority decides alone
    assert friction("ball0", "ball2") == (3, pytest.approx([0.33, 0.0, 0.0]))
    assert friction("ground", "ball2") == (6, pytest.approx([1.0, 0.0, 0.02], rel=1e-6))


def test_the_ground_lies_where_it_lies_here():
    builder = sw.ModelBuilder()
    y, x = np.meshgrid(np.linspace(-2, 2, 9), np.linspace(-3, 3, 7), indexing="ij")
    heights = 0.5 + 0.1 * x - 0.07 * y  # in a plane: triangles of any cut have it
    builder.add_shape_height_field(sw.WORLD, heights, size=(6.0, 4.0), scale=(1.0, 1.0, 2.0), name="slope",
                                   pose=sw.pose((1.0, 2.0, 0.3)))  # fmt: skip
    bump = np.zeros((5, 5))
    bump[1, 3] = 0.25
    builder.add_shape_height_field(sw.WORLD, bump, size=(2.0, 2.0), name="bump", pose=sw.pose((20.0, 0.0, 0.0)))
    builder.add_shape_height_field(sw.WORLD, np.zeros((3, 3)), size=(2.0, 2.0), pose=sw.pose((30.0, 0.0, 0.4)))
    builder.add_solid("ball", "sphere", 0.1, mass=1.0)
    theirs = mujoco.MjModel.from_xml_string(mjcf_of(builder.finalize(1, "cpu")).text)
    data = mujoco.MjData(theirs)
    mujoco.mj_forward(theirs, data)

    def height(x, y):
        down = np.array([0.0, 0.0, -1.0])
        return 5.0 - mujoco.mj_ray(theirs, data, np.array([x, y, 5.0]), down, None, 1, -1, np.zeros(1, np.int32))

    for px, py in ((0.0, 0.0), (1.3, -0.8), (-2.1, 1.7), (2.4, -1.9)):
        assert height(1.0 + px, 2.0 + py) == pytest.approx(0.3 + 2.0 * (0.5 + 0.1 * px - 0.07 * py), abs=1e-5)
    assert height(20.5, -0.5) == pytest.approx(0.25, abs=1e-5)  # row 1 is at y = -0.5, column 3 at x = 0.5
    assert height(19.5, 0.5) == pytest.approx(0.0, abs=1e-5)
    assert height(30.2, 0.3) == pytest.approx(0.4, abs=1e-5)


def test_hulls_and_ellipsoids_and_margins():
    builder = sw.ModelBuilder()
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]) * 0.2
    body = builder.add_body("body", mass=1.0, inertia=(1, 1, 1), pose=sw.pose((0, 0, 1)))
    builder.add_shape_hull(body, corners, name="hull", scale=(1.0, 2.0, 1.0), pose=sw.pose((0.5, 0.0, 0.0)))
    builder.add_shape_ellipsoid(body, half=(0.1, 0.2, 0.3), name="egg", pose=sw.pose((-0.5, 0.0, 0.0)))
    builder.add_shape_sphere(body, radius=0.1, margin=0.02, name="ball", pose=sw.pose((0.0, 0.5, 0.0)))
    builder.add_shape_box(body, half=(0.1, 0.1, 0.1), margin=0.02, name="box", pose=sw.pose((0.0, -0.5, 0.0)))
    builder.add_shape_plane(material=sw.Material(restitution=0.5), name="ground")
    builder.add_shape_groove(sw.WORLD, radius=1.0, half_width=0.5, name="groove")
    made = mjcf_of(builder.finalize(1, "cpu"))
    theirs = mujoco.MjModel.from_xml_string(made.text)
    assert set(made.notes) == {"margin of shape 'box'", "shape 'groove': MJCF has no groove"}
    assert theirs.geom("ball").size[0] == pytest.approx(0.12)
    data = mujoco.MjData(theirs)
    mujoco.mj_forward(theirs, data)
    mesh = theirs.geom("hull").dataid[0]
    first, count = theirs.mesh_vertadr[mesh], theirs.mesh_vertnum[mesh]
    turn = data.geom("hull").xmat.reshape(3, 3)
    found = theirs.mesh_vert[first : first + count] @ turn.T + data.geom("hull").xpos
    expected = corners * (1.0, 2.0, 1.0) + (0.5, 0.0, 1.0)
    assert np.abs(found[:, None] - expected[None]).sum(axis=2).min(axis=0).max() < 1e-6


def test_each_world_is_written_with_its_own_numbers():
    builder = servo_hexapod()
    model = builder.finalize(2, "cpu", per_world=["body_mass", "drive_stiffness", "shape_friction", "shape_enabled"])
    model.body_mass[1, 0] = 2.5
    model.drive_stiffness[1] = 7.0
    model.shape_friction[1] = 0.25
    model.shape_enabled[1, model.shape_names.index("foot_3")] = 0
    first, second = (mujoco.MjModel.from_xml_string(mjcf_of(model, world=world).text) for world in range(2))
    assert second.body("base").mass[0] == 2.5 != first.body("base").mass[0]
    assert set(second.actuator_gainprm[:, 0]) == {7.0}
    assert set(first.actuator_gainprm[:, 0]) == {12.0}
    assert set(second.pair_friction[:, 0]) == {0.25}
    assert second.ngeom == first.ngeom - 1
    assert second.npair == first.npair - 1


def chained():
    """Two bodies that hang on each other."""
    builder = sw.ModelBuilder()
    first = builder.add_body("first", mass=1.0, inertia=(1, 1, 1))
    second = builder.add_body("second", mass=1.0, inertia=(1, 1, 1), pose=sw.pose((1, 0, 0)))
    return builder, first, second


def looped():
    builder, first, second = chained()
    builder.add_joint_revolute("one", sw.WORLD, first, axis=(0, 0, 1))
    builder.add_joint_revolute("two", first, second, axis=(0, 0, 1))
    builder.add_joint_revolute("three", sw.WORLD, second, axis=(0, 0, 1))
    return builder


def sprung():
    builder, first, second = chained()
    builder.add_spring("spring", first, second, anchor0=(0, 0, 0), anchor1=(1, 0, 0), stiffness=1.0)
    return builder


def geared():
    builder, first, second = chained()
    joints = [builder.add_joint_revolute(name, sw.WORLD, body, axis=(0, 0, 1))
              for name, body in (("one", first), ("two", second))]  # fmt: skip
    builder.add_coupling("gear", [(joints[0], 1.0), (joints[1], -2.0)])
    return builder


def driven():
    builder, first, _ = chained()
    builder.add_joint_revolute("one", sw.WORLD, first, axis=(0, 0, 1), drive=sw.VelocityMotor(effort_limit=1.0))
    return builder


def tabled():
    builder, first, _ = chained()
    table = ((-1.0, 0.0, 1.0), (-1.0, 0.0, 3.0))
    builder.add_joint_revolute("one", sw.WORLD, first, axis=(0, 0, 1), spring_table=table)
    return builder


def coned():
    builder, first, _ = chained()
    builder.add_shape_cone(first, radius=0.1, half_length=0.2, name="cone")
    return builder


def planed():
    builder, first, _ = chained()
    builder.add_shape_plane(first, name="wing")
    return builder


def hung():
    builder, first, second = chained()
    builder.add_joint_fixed("stand", sw.WORLD, first)
    builder.add_joint_spherical("ball", second, first, anchor=(0.5, 0, 0))
    return builder


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (looped, "joint 'three': the model must be a tree, but it closes a loop"),
        (sprung, "joint 'spring': its type must be one that bodies of a tree have, got DISTANCE"),
        (geared, "couplings are not written, got 'gear'"),
        (driven, "joint 'one': drives must be PositionDrive of a hinge or slide, got VelocityMotor"),
        (tabled, "joint 'one': laws must be linear"),
        (coned, "shape 'cone': a CONE is not written"),
        (planed, "shape 'wing': a plane must be on WORLD, got body 'first'"),
        (hung, "joint 'ball': a ball must lead from the body nearer to the root"),
    ],
)
def test_what_cannot_be_written_is_told_in_one_line(build, words):
    with pytest.raises(sw.ModelError, match=words) as caught:
        mjcf_of(build().finalize(1, "cpu"))
    assert "\n" not in str(caught.value)


def test_options_are_checked(tmp_path):
    model = scenes.ant().finalize(2, "cpu")
    with pytest.raises(sw.ModelError, match="world must be an integer >= 0 and <= 1"):
        mjcf_of(model, world=2)
    with pytest.raises(sw.ModelError, match="timestep must be positive"):
        mjcf_of(model, timestep=0.0)
    with pytest.raises(sw.ModelError, match="pass what finalize returned"):
        mjcf_of(scenes.ant())  # type: ignore[arg-type]
    with pytest.raises(FileError, match="save_mjcf"):
        save_mjcf(model, tmp_path / "none" / "ant.xml")
    made = save_mjcf(model, tmp_path / "ant.xml")
    assert (tmp_path / "ant.xml").read_text(encoding="utf-8") == made.text
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "ant.xml")).nbody == model.body_count + 1


def test_contacts_and_stops_are_as_soft_as_asked_for():
    model = servo_hexapod().finalize(1, "cpu")
    for softness in (0.02, 0.006):
        theirs = mujoco.MjModel.from_xml_string(mjcf_of(model, softness=softness).text)
        assert set(theirs.pair_solref[:, 0]) == set(theirs.jnt_solref[1:, 0]) == {softness}
    with pytest.raises(sw.ModelError, match="softness must be positive"):
        mjcf_of(model, softness=-1.0)


def test_actuators_push_as_ours_do():
    specs = [
        ActuatorSpec(name="push", terms=((0, 2.0),), gain=(1.0, 0.2, -0.1), bias=(0.3, -1.0, -0.2), length_offset=0.4),
        ActuatorSpec(name="both", terms=((0, -0.5), (1, 1.5)), ctrl_range=(-0.5, 0.8), force_range=(-0.6, 0.7)),
        ActuatorSpec(name="slow", terms=((1, 1.0),), activation=Activation.FILTER, time_constant=0.02),
        pd_actuator("pd", 1, stiffness=4.0, damping=0.3, effort_limit=0.5, delay=0.001),
        dc_motor("motor", 1, stall_torque=2.0, free_speed=5.0),
    ]
    model = bodies().finalize(2, "cpu")
    motors = Actuators(model, specs, dt=1e-3, per_world=["gain"])
    motors.gain[1, 0] = (3.0, 0.0, 0.0)
    sim = sw.Simulation(model, 1e-3, elements=[motors])
    start(sim, (0.3, -0.2), (0.5, -1.0))
    controls = [0.7, 1.5, -0.4, 0.1, 0.2]
    for world in range(2):
        made = mjcf_of(model, actuators=motors, world=world)
        assert made.notes == ("delay of actuator 'pd'", "torque-speed curve of actuator 'motor'")
        theirs = mujoco.MjModel.from_xml_string(made.text)
        data = mujoco.MjData(theirs)
        data.qpos[:], data.qvel[:], data.ctrl[:] = (0.3, -0.2), (0.5, -1.0), controls
        mujoco.mj_forward(theirs, data)
        if world == 0:
            motors.ctrl[...] = controls
            sim.step()
        ours = motors.force.numpy()[world]
        # without the delayed one, whose control has not come through, and the curve, which does not act here
        kept = [0, 1, 2, 4]
        np.testing.assert_allclose(data.actuator_force[kept], ours[kept], rtol=1e-5, atol=1e-6)
        assert data.actuator_force[3] == pytest.approx(0.5)


def test_actuators_that_the_file_cannot_have():
    model = scenes.ant().finalize(1, "cpu")
    pull = Actuators(model, [ActuatorSpec(name="pull", site=SitePull(body=0))])
    with pytest.raises(sw.ModelError, match="actuator 'pull': pulls on frames are not written"):
        mjcf_of(model, actuators=pull)
    with pytest.raises(sw.ModelError, match="actuators must be Actuators of the same model"):
        mjcf_of(scenes.ant().finalize(1, "cpu"), actuators=pull)
