"""Robot arms: masses, weights and inertias against published numbers, frames against the sources, stops, shapes."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import simwarp as sw
from simwarp.scenes import IRB120, RACER3, Arm, robot_arm
from tests.reference import kinematics as reference

ROBOTS = Path(__file__).parents[3] / "../shared/reference/robots"
GRAVITY = 9.8
H = 1e-4


def simulation_of(arm: Arm, worlds: int, dt: float = H, **options: Any) -> sw.Simulation:
    builder = robot_arm(arm, **options)
    builder.gravity = np.array([0.0, 0.0, -GRAVITY])
    return sw.Simulation(builder.finalize(world_count=worlds, device="cpu"), dt=dt)


def mass_matrix_and_weight(arm: Arm, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """M and the torques that hold the arm at zero: a unit effort in a world each, and one world without."""
    simulation = simulation_of(arm, 7, **options)
    torque = np.array([10.0, 10.0, 5.0, 1.0, 1.0, 0.1])
    force = np.zeros((7, 6), np.float32)
    force[1:] = np.diag(torque)
    simulation.control.joint_force.assign(force)
    simulation.step()
    rate = simulation.state.joint_qd.numpy().astype(np.float64)
    mass = np.linalg.inv(((rate[1:] - rate[0]) / H / torque[:, None]).T)
    return mass, -mass @ rate[0] / H


def worst_weight(arm: Arm, joints: list[int], **options: Any) -> np.ndarray:
    """Largest torques that gravity asks for over angles of joints 2, 3, 4 and 5, as differences of its energy."""
    low, high = np.array([joint.limit for joint in arm.joints]).T
    rng = np.random.default_rng(0)
    q = np.zeros((3000, 6))
    q[:, 1:5] = rng.uniform(low[1:5], high[1:5], (3000, 4))
    # stretched, and folded, which chance does not meet
    q[:400, 2:5] = np.array([[a, b, c] for a in (-1.5, 1.5, *np.linspace(-0.3, 0.3, 8)) for b in (0.0, 1.57, 3.1, -1.57)
                             for c in np.linspace(-1.7, 1.7, 10)])  # fmt: skip
    q[:, 1:5] = np.clip(q[:, 1:5], low[1:5], high[1:5])
    simulation = simulation_of(arm, len(q), **options)
    worst = []
    for joint in joints:
        energies = []
        for sign in (1.0, -1.0):
            there = q.copy()
            there[:, joint] += 0.01 * sign  # a difference of a sine: 2e-5 of it are lost
            simulation.set_joint_state(None, there.astype(np.float32), None)
            energies.append(simulation.measure_energy().numpy().copy())
        worst.append(np.abs(energies[0] - energies[1]).max() / 0.02)
    return np.array(worst)


def test_the_racer3_weighs_what_its_parts_do():
    assert RACER3.mass == pytest.approx(27.660, abs=5e-4)
    assert sum(body.mass for body in robot_arm(RACER3).bodies) == pytest.approx(27.660, abs=5e-4)
    assert IRB120.mass == pytest.approx(18.146 + 0.570098, abs=1e-6)
    assert sum(body.mass for body in robot_arm(IRB120, hand=False).bodies) == pytest.approx(18.146, abs=1e-6)


def test_the_racer3_at_zero_is_as_heavy_as_published():
    mass, weight = mass_matrix_and_weight(RACER3)
    # half of the last digit, and 1e-5 of a float32 step
    np.testing.assert_allclose(np.diag(mass), [0.8471, 1.7793, 0.5138, 0.0311, 0.0171, 0.0004], atol=6e-5)
    np.testing.assert_allclose(weight, [0.0, 15.36, 16.41, 0.06, 1.38, 0.0], atol=6e-3)
    np.testing.assert_allclose(mass, mass.T, atol=1e-4)


def test_the_worst_weights_are_those_published():
    # what chance and a grid find is below the worst, and within a percent of it
    found = worst_weight(RACER3, [1, 2, 3, 4])
    published = np.array([55.9, 17.0, 1.57, 1.38])
    assert (found <= published * 1.004).all()
    assert (found >= published * 0.985).all()


def test_the_irb120_without_hand_asks_for_the_torques_published():
    found = worst_weight(IRB120, [1, 2], hand=False)
    published = np.array([23.5, 6.5])
    assert (found <= published * 1.01).all()
    assert (found >= published * 0.98).all()
    with_hand = worst_weight(IRB120, [1, 2, 3, 4])
    assert (with_hand < [0.5 * joint.torque for joint in IRB120.joints[1:5]]).all()


@pytest.mark.parametrize(("arm", "place"), [(RACER3, (-0.5902, 0.0, 0.6850)), (IRB120, (0.5328, 0.0, 0.63))])
def test_the_grip_is_where_it_was_published(arm, place):
    np.testing.assert_allclose(arm.grip, place, atol=7e-5)
    # between the fingers, at their tips
    fingers = np.array([shape.centre for shape in arm.shapes if shape.name in arm.fingers])
    middle = fingers.mean(axis=0)
    reach = float(arm.grip[0]) - middle[0]
    assert abs(reach) == pytest.approx(0.0105, abs=1e-4)
    np.testing.assert_allclose(middle[1:], arm.grip[1:], atol=1e-4)


def test_joints_turn_as_the_frames_say():
    for arm in (RACER3, IRB120):
        builder = robot_arm(arm)
        q = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 6)).astype(np.float32)
        simulation = simulation_of(arm, 3)
        simulation.set_joint_state(None, q, None)
        hand = len(builder.bodies) - 1
        for world in range(3):
            pose = reference.body_pose(builder, hand, q[world].astype(np.float64))
            np.testing.assert_allclose(simulation.state.body_x.numpy()[world, hand], pose[:3, 3], atol=1e-6)


@pytest.mark.parametrize("arm", [RACER3, IRB120], ids=["racer3", "irb120"])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_joints_stop_at_their_limits(arm, sign):
    simulation = simulation_of(arm, 6, dt=1e-3, ground=False)
    low, high = np.array([joint.limit for joint in arm.joints]).T
    start = np.diag(np.where(sign > 0.0, high, low) - sign * 0.05).astype(np.float32)
    simulation.set_joint_state(None, start, (sign * np.eye(6) * 1.0).astype(np.float32))
    simulation.control.joint_force.assign((sign * np.diag([joint.torque for joint in arm.joints])).astype(np.float32))
    most = np.zeros(6)
    for _ in range(100):
        simulation.step()
        q = simulation.state.joint_q.numpy()
        most = np.maximum(most, np.where(sign > 0.0, np.diag(q) - high, low - np.diag(q)))
    # a step of a millisecond at the speed of arrival, of a few rad/s, and 30 rad/s of the light last joint
    assert most.max() < 0.02
    assert most.min() > -0.02


def test_at_zero_nothing_touches_anything():
    for arm in (RACER3, IRB120):
        simulation = simulation_of(arm, 1)
        simulation.step()
        assert simulation.contacts.contact_count.numpy()[0] == 0
        assert "floor" in simulation.model.shape_names
        assert {*arm.barred, *arm.fingers} <= {*simulation.model.shape_names}


def test_the_forearm_meets_the_upper_arm_and_the_ground():
    simulation = simulation_of(RACER3, 2)
    q = np.zeros((2, 6), np.float32)
    q[0, [2, 4]] = np.radians([-95.0, 90.0])  # folded, the hand level
    q[1, [1, 2, 4]] = np.radians([-95.0, 5.0, 90.0])  # the wrist 3.5 cm above the ground, the hand level
    simulation.set_joint_state(None, q, None)
    simulation.step()
    names, contacts = np.array(simulation.model.shape_names), simulation.contacts
    pairs = []
    for world in range(2):
        count = int(contacts.contact_count.numpy()[world])
        first, second = (array.numpy()[world, :count] for array in (contacts.contact_shape0, contacts.contact_shape1))
        pairs.append({*zip(names[first].tolist(), names[second].tolist(), strict=True)})
    assert pairs[0]
    assert pairs[0] <= {("upper_arm", "forearm_1"), ("upper_arm", "forearm_2")}
    assert pairs[1] == {("floor", "forearm_1"), ("floor", "forearm_2")} or pairs[1] == {
        ("forearm_1", "floor"), ("forearm_2", "floor"),
    }  # fmt: skip


def test_the_tables_are_those_of_the_sources():
    path = ROBOTS / "arms/racer3.json"
    if not path.is_file():
        pytest.skip("the sources are not here")
    data = json.loads(path.read_text())
    for link, given in zip(RACER3.links, data["links"], strict=True):
        assert (link.mass, list(link.centre)) == (given["mass"], given["com"])
        assert [*link.moments, *link.products] == given["inertia_xx_yy_zz_xy_xz_yz"]
    for joint, given in zip(RACER3.joints, data["joints"], strict=True):
        assert (list(joint.point), list(joint.axis)) == (given["point"], given["axis"])
        np.testing.assert_allclose(np.degrees(joint.limit), given["limit_deg"], rtol=1e-12)
        assert joint.torque == given["max_torque_Nm"]
        assert math.degrees(joint.speed) == pytest.approx(given["max_speed_deg_s"])
    assert list(RACER3.grip) == data["grip"]["point"]
    for shape, given in zip(RACER3.shapes, data["collision"], strict=True):
        assert list(shape.centre) == given["centre"]
        sizes = given["half"] if given["shape"] == "box" else [given["radius"], given["half_length"], given["radius"]]
        assert list(shape.size) == sizes


def test_the_irb120_is_that_of_its_urdf():
    path = ROBOTS / "urdf/abb_irb120_support/urdf/irb120_3_58.urdf"
    if not path.is_file():
        pytest.skip("the sources are not here")
    root = ElementTree.parse(path).getroot()
    origin, at = {"base_link": np.zeros(3)}, np.zeros(3)
    hinges = [joint for joint in root.iter("joint") if joint.get("type") == "revolute"]
    for joint, given in zip(IRB120.joints, hinges, strict=True):
        at = at + numbers(given, "origin", "xyz")
        origin[text(given, "child", "link")] = at
        np.testing.assert_allclose(joint.point, at, atol=1e-12)
        limit = [float(text(given, "limit", key)) for key in ("lower", "upper", "velocity")]
        assert [*joint.limit, joint.speed] == limit
        np.testing.assert_allclose(joint.axis, numbers(given, "axis", "xyz"))
    for link in IRB120.links[:-1]:
        named = next(found for found in root.iter("link") if found.get("name") == link.name)
        assert link.mass == float(text(named, "inertial/mass", "value"))
        centre = origin[link.name] + numbers(named, "inertial/origin", "xyz")
        np.testing.assert_allclose(link.centre, centre, atol=1e-12)
        inertia = [float(text(named, "inertial/inertia", key)) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")]
        assert [*link.moments, *link.products] == inertia


def text(element: ElementTree.Element, path: str, key: str) -> str:
    found = element.find(path)
    assert found is not None
    return found.get(key) or ""


def numbers(element: ElementTree.Element, path: str, key: str) -> np.ndarray:
    return np.array([float(part) for part in text(element, path, key).split()])
