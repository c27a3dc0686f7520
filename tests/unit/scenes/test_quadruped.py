"""The quadruped by code: its published numbers, its mirror image, that it stands, and the same robot of a file."""

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

import simwarp as sw
from simwarp.core.interop import to_torch
from simwarp.scenes import (
    QUADRUPED_FEET,
    QUADRUPED_FOOT_RADIUS,
    QUADRUPED_LEGS,
    QUADRUPED_LINK,
    QUADRUPED_STANCE,
    QUADRUPED_STANCE_HEIGHT,
    QUADRUPED_TORQUES,
    quadruped,
    show_quadruped,
)
from simwarp.sensors import Visuals

GO2 = Path(__file__).parents[3] / "../shared/reference/robots/mjcf/go2/go2.xml"
MASS = 6.921 + 4 * (0.678 + 1.152 + 0.2414)
WEIGHT = 9.81 * MASS
JOINTS = [f"{leg}_{part}_joint" for leg in ("FL", "FR", "RL", "RR") for part in ("hip", "thigh", "calf")]


def standing(*, worlds=1, height=QUADRUPED_STANCE_HEIGHT, tolerance=1e-5, q=None, **options):
    """A simulation of quadrupeds in their stance, whose drives hold it; ``q`` are angles of the joints."""
    model = quadruped(**options).finalize(world_count=worlds, device="cpu")
    simulation = sw.Simulation(model, dt=0.005, solver=sw.SolverOptions(tolerance=tolerance))
    start = torch.zeros(worlds, model.dof_count)
    start[:, 2] = height
    start[:, 6:] = torch.tensor(list(QUADRUPED_STANCE.values())) if q is None else q
    simulation.set_joint_state(None, start, torch.zeros_like(start))
    to_torch(simulation.control.joint_target_q).copy_(start)
    return simulation


def points(simulation):
    """Middles of all shapes in the world, by name [m]."""
    model, pose = simulation.model, simulation.state.body_q.numpy()[0]
    bodies, offsets = model.topology.shape_body.numpy(), model.shape_x.numpy()[0]
    return {
        name: pose[body, :3] + Rotation.from_quat(pose[body, 3:]).apply(offset)
        for name, body, offset in zip(model.shape_names, bodies, offsets, strict=True)
        if body >= 0
    }


def test_it_has_the_published_masses_and_joints_in_order():
    builder = quadruped()
    assert sum(body.mass for body in builder.bodies) == pytest.approx(MASS, abs=1e-9)
    model = builder.finalize(world_count=1, device="cpu")
    assert list(model.joint_names) == ["base", *JOINTS] == ["base", *QUADRUPED_STANCE]
    assert [model.dof(joint) for joint in JOINTS] == list(range(6, 18))
    limits = model.drive_effort_limit.numpy()[0, 6:].reshape(4, 3)
    np.testing.assert_allclose(limits, [list(QUADRUPED_TORQUES.values())] * 4, rtol=1e-6)


def test_links_have_their_length_and_the_stance_puts_feet_on_the_ground_under_the_hips():
    simulation = standing()
    model = simulation.model
    place = points(simulation)
    anchors = model.parameters.joint_anchor0.numpy()[0]
    pose = simulation.state.body_q.numpy()[0]
    for leg in QUADRUPED_LEGS:
        foot = place[f"{leg}_foot"]
        # 1e-6 m: poses in float32 of some decimetres
        assert foot[2] == pytest.approx(QUADRUPED_FOOT_RADIUS, abs=1e-6)
        hip = model.body(f"{leg}_hip")
        thigh, calf = model.joint(f"{leg}_thigh_joint"), model.joint(f"{leg}_calf_joint")
        shoulder = pose[hip, :3] + Rotation.from_quat(pose[hip, 3:]).apply(anchors[thigh])
        upper = model.body(f"{leg}_thigh")
        knee = pose[upper, :3] + Rotation.from_quat(pose[upper, 3:]).apply(anchors[calf])
        assert np.linalg.norm(knee - shoulder) == pytest.approx(QUADRUPED_LINK, abs=1e-6)
        assert np.linalg.norm(foot - knee) == pytest.approx(QUADRUPED_LINK, abs=1e-6)
        np.testing.assert_allclose(foot[:2], shoulder[:2], atol=1e-6)


def test_only_feet_touch_flat_ground_in_the_stance_and_its_parts_never_each_other():
    builder = quadruped()
    model = builder.finalize(world_count=1, device="cpu")
    start, other = model.topology.pair_start.numpy(), model.topology.pair_other.numpy()
    floor = model.shape_names.index("floor")
    assert floor == 0
    assert sorted(other[start[floor] : start[floor + 1]].tolist()) == list(range(1, 14))
    assert model.topology.pair_count == 13
    simulation = standing()
    for _ in range(20):
        simulation.step()
    force = simulation.contacts.shape_contact_force.numpy()[0]
    touching = {name for name, each in zip(model.shape_names, force, strict=True) if np.abs(each).max() > 0.0}
    assert touching == {"floor", *QUADRUPED_FEET}


def test_left_is_the_mirror_image_of_right():
    generator = torch.Generator().manual_seed(0)
    angles = 0.3 * torch.rand(1, 12, generator=generator) - 0.15
    stance = torch.tensor(list(QUADRUPED_STANCE.values()))
    # Legs change sides; hips turn the other way
    mirrored = angles.view(4, 3)[[1, 0, 3, 2]] * torch.tensor([-1.0, 1.0, 1.0])
    one, other = (standing(height=0.4, q=stance + each.view(1, 12)) for each in (angles, mirrored))
    for step in range(60):
        for simulation, sign in ((one, 1.0), (other, -1.0)):
            to_torch(simulation.control.body_force)[0, 0, 1] = sign * 20.0 * (step < 20)
            simulation.step()
    a, b = (each.state.joint_q.numpy()[0] for each in (one, other))
    np.testing.assert_allclose(b[:6], a[:6] * [1, -1, 1, -1, 1, -1], atol=1e-4)
    # 1e-4 rad: the solve goes on to 1e-5 m/s in another order of the legs, for 60 steps of 5 ms on a leg of 0.4 m
    np.testing.assert_allclose(b[6:].reshape(4, 3), a[6:].reshape(4, 3)[[1, 0, 3, 2]] * [-1, 1, 1], atol=1e-4)


def test_it_stands_still_on_its_feet():
    simulation = standing()
    for _ in range(1600):  # 8 s: the slowest mode, to and fro over the feet, has a period of some
        simulation.step()
    before = simulation.state.joint_q.numpy()[0].copy()
    for _ in range(200):
        simulation.step()
    after = simulation.state.joint_q.numpy()[0]
    names = simulation.model.shape_names
    force = simulation.contacts.shape_contact_force.numpy()[0]
    feet = np.array([force[names.index(foot)] for foot in QUADRUPED_FEET])
    # A residual of 1e-5 m/s of 15 kg in 5 ms is 0.03 N
    assert feet[:, 2].sum() == pytest.approx(WEIGHT, abs=0.03)
    # Drives of 40 N·m/rad carry a quarter of the weight at a lever of 0.153 m: knees give by 0.14 rad
    lever = QUADRUPED_LINK * np.sin(0.8)
    sag = 2.0 * lever * (WEIGHT / 4.0 * lever / 40.0)
    assert QUADRUPED_STANCE_HEIGHT - after[2] < 1.5 * sag
    # A second at a residual of 1e-5 m/s
    np.testing.assert_allclose(after, before, atol=5e-4)


def test_torques_are_limited():
    """A drive far from its target pushes with the largest torque: so does the same torque by hand."""
    by_drive, by_hand = standing(height=1.0, gains=(1e4, 0.0)), standing(height=1.0, gains=None)
    to_torch(by_drive.control.joint_target_q)[:, 8] += 1.0
    to_torch(by_hand.control.joint_force)[:, 8] = QUADRUPED_TORQUES["calf"]
    by_drive.step()
    by_hand.step()
    driven, pushed = (each.state.joint_qd.numpy()[0, 8] for each in (by_drive, by_hand))
    # Other drives of one robot hold their joints, those of the other do not: the calf alone is light
    assert driven == pytest.approx(pushed, rel=0.2)
    assert driven > 5.0


def test_pictures_show_more_than_touches():
    builder = quadruped()
    visuals = Visuals(builder)
    shapes = len(visuals.instances)
    show_quadruped(visuals)
    assert len(visuals.instances) == shapes + 10


@pytest.mark.skipif(not GO2.exists(), reason="no reference robots here")
def test_it_is_the_robot_of_the_file():
    other = sw.importers.load_mjcf(GO2)
    ours = quadruped()
    assert other.mass == pytest.approx(MASS, rel=1e-4)
    theirs = other.builder
    masses = {body.name: body for body in theirs.bodies}
    for body in ours.bodies:
        twin = masses["base_link" if body.name == "trunk" else body.name]
        assert body.mass == pytest.approx(twin.mass, rel=1e-3)
        # Rounded to a tenth of a millimetre; both stand with straight legs, ours with its soles on the ground
        shift = np.array([0.0, 0.0, 2 * QUADRUPED_LINK + QUADRUPED_FOOT_RADIUS - 0.445])
        np.testing.assert_allclose(body.pose.position, np.asarray(twin.pose.position) + shift, atol=3e-4)
        # Rounded to three digits, some from another decimal; products of inertia are left out
        np.testing.assert_allclose(np.diag(body.inertia), np.diag(twin.inertia), rtol=0.02, atol=5e-6)
    hinges = [joint for joint in theirs.joints if joint.name.endswith("_joint")]
    assert [joint.name for joint in hinges] == JOINTS
    for mine, hinge in zip(ours.joints[1:], hinges, strict=True):
        limit = hinge.dofs[0].limit
        assert limit is not None
        np.testing.assert_allclose(np.array(mine.dofs[0].limit), np.array(limit), atol=1e-4)
