"""Centres of mass that differ by world: a drawn shift does what a model built with it does."""

from typing import Any

import numpy as np
import pytest
import torch

from simwarp import WORLD, pose, to_torch
from simwarp.tasks import InputError, Mode, Range, TaskConfig, make
from simwarp.tasks.framework.rotations import in_world_axes
from tests.tasks.randomisation.idle_task import IdleTask

SHIFT = (0.04, -0.02, 0.03)
CORNER = (0.2, 0.15, 0.1)


class Things(IdleTask):
    """A box that falls and tumbles, and a double pendulum, with centres of mass that are built at `SHIFT` or drawn."""

    name = "things-with-centres"
    built = (0.0, 0.0, 0.0)
    joined = True
    """Whether the box has a free joint of its own, whose coordinates place it."""

    def build(self, builder):
        d = np.array(self.built)
        turned = (0.0, 0.0, np.sin(0.3), np.cos(0.3))
        turn = np.array([[np.cos(0.6), -np.sin(0.6), 0.0], [np.sin(0.6), np.cos(0.6), 0.0], [0.0, 0.0, 1.0]])
        box = builder.add_body(
            "box", mass=2.0, inertia=(0.02, 0.03, 0.04), pose=pose(tuple((0.0, 0.0, 0.6) + turn @ d), turned),
            omega=(1.0, 2.0, 0.5), velocity=tuple(np.cross((1.0, 2.0, 0.5), turn @ d)),
        )  # fmt: skip
        if self.joined:
            builder.add_joint_free("box_place", box, anchor=(0.0, 0.0, 0.6))
        builder.add_shape_box(box, half=CORNER, pose=pose(tuple(-d)), name="box")
        upper = builder.add_body(
            "upper", mass=1.0, inertia=(0.02, 0.02, 0.01), pose=pose(tuple(np.array((2.0, 0.0, 1.5)) + d))
        )
        lower = builder.add_body(
            "lower", mass=1.0, inertia=(0.02, 0.02, 0.01), pose=pose(tuple(np.array((2.0, 0.0, 1.0)) + d))
        )
        builder.add_joint_revolute("shoulder", WORLD, upper, axis=(0, 1, 0), anchor=(1.8, 0.0, 1.7))
        builder.add_joint_revolute("elbow", upper, lower, axis=(1, 1, 0), anchor=(2.0, 0.0, 1.25))
        builder.add_shape_sphere(lower, radius=0.1, pose=pose(tuple(-d)), name="ball")
        builder.add_shape_plane(name="ground")


class Shifted(Things):
    name = "things-built-with-shifts"
    built = SHIFT


class Loose(Things):
    name = "things-without-a-free-joint"
    joined = False


class LooseShifted(Loose):
    name = "things-without-a-free-joint-built-with-shifts"
    built = SHIFT


def everywhere(mode=Mode.SET, **options):
    return {f"body_com_{axis}": Range(d, d, mode=mode, **options) for axis, d in zip("xyz", SHIFT, strict=True)}


@pytest.mark.parametrize(("things", "shifted"), [(Things, Shifted), (Loose, LooseShifted)])
def test_a_drawn_shift_is_that_of_a_model_built_with_it(things, shifted):
    drawn, built = things(TaskConfig(randomise=everywhere()), 2), shifted(TaskConfig(), 2)
    for task in (drawn, built):
        task.restart(3)
    # Coordinates of the same joints: places of the bodies' shapes, not of their centres. The box lands after 0.3 s; the
    # two differ by the rounding of float32, 1e-7, which its tumbling multiplies
    for _ in range(50):
        for task in (drawn, built):
            task.step(torch.zeros(2, 1))
        assert torch.allclose(drawn.views.joint_q, built.views.joint_q, atol=1e-5)
    assert torch.allclose(drawn.views.body_q, built.views.body_q, atol=1e-5)
    plain = things(TaskConfig(), 2)
    for _ in range(35):
        plain.step(torch.zeros(2, 1))
    assert (plain.views.joint_q - built.views.joint_q).abs().max() > 0.05


def shape_places(task):
    """(W, S, 3) float64 origins of the shapes of bodies, world axes [m], and (W, S, 3) their velocities [m/s]."""
    model, state = task.simulation.model, task.simulation.state
    body = to_torch(model.topology.shape_body).long()
    own = (body >= 0).nonzero().squeeze(1)
    on = body[own]
    arm = in_world_axes(to_torch(state.body_rot)[:, on], to_torch(model.shape_x)[:, own])
    spin = to_torch(state.body_omega)[:, on].double()
    return to_torch(state.body_x)[:, on] + arm, to_torch(state.body_v)[:, on] + torch.linalg.cross(spin, arm)


def test_bodies_without_joints_stay_where_they_were_as_rigid_bodies_do():
    """The box tumbles at its start: its shape keeps place and velocity, its centre is d further and turns with it."""
    plain = Loose(TaskConfig(), 4)
    task = Loose(TaskConfig(randomise=everywhere()), 4)
    place, velocity = shape_places(plain)
    there, its_velocity = shape_places(task)
    assert torch.allclose(there, place, rtol=0.0, atol=1e-12)
    assert torch.allclose(its_velocity, velocity, rtol=0.0, atol=1e-6)
    box = task.simulation.model.body("box")
    moved = to_torch(task.simulation.state.body_x)[:, box] - to_torch(plain.simulation.state.body_x)[:, box]
    turned = in_world_axes(to_torch(plain.simulation.state.body_rot)[:, box], torch.tensor(SHIFT).double().expand(4, 3))
    assert torch.allclose(moved, turned, rtol=0.0, atol=1e-8)  # a range is of float32


def test_a_new_episode_moves_the_bodies_without_joints_of_its_world_alone():
    task = Loose(TaskConfig(randomise={"body_com_x": Range(-0.05, 0.05, mode="add", only="box")}), 4)
    for _ in range(5):
        task.step(torch.zeros(4, 1))
    state = task.simulation.state
    before = {name: getattr(state, name).numpy().copy() for name in ("body_x", "body_q", "body_v", "body_omega")}
    shapes = shape_places(Loose(TaskConfig(), 4))[0]
    task.begin_episodes(torch.tensor([False, True, False, False]))
    for name, values in before.items():
        now = getattr(state, name).numpy()
        assert np.array_equal(now[[0, 2, 3]], values[[0, 2, 3]]), name
        assert not np.array_equal(now[1], values[1]), name
    for _ in range(2):  # shifts of episodes do not add up
        assert torch.allclose(shape_places(task)[0][1], shapes[1], rtol=0.0, atol=1e-12)
        task.begin_episodes(torch.tensor([False, True, False, False]))


def test_what_is_named_moves_in_the_worlds_that_begin_and_nothing_else():
    ranges = {"body_com_x": Range(-0.05, 0.05, mode="add", only="lower")}
    task, plain = Things(TaskConfig(randomise=ranges), 4), Things(TaskConfig(), 1)
    model, built = task.simulation.model, plain.simulation.model
    elbow = model.joint("elbow")
    before = to_torch(model.joint_anchor1).clone()
    moved = before[:, elbow, 0] - to_torch(built.joint_anchor1)[:, elbow, 0]
    assert (moved.abs() > 1e-4).all()
    assert (moved.abs() <= 0.05).all()
    assert len(set(moved.tolist())) == 4
    shapes = to_torch(model.shape_x)[:, :, 0] - to_torch(built.shape_x)[:, :, 0]
    assert torch.allclose(shapes[:, 1], moved)  # the ball goes with the joint
    assert (shapes[:, [0, 2]] == 0.0).all()
    assert torch.equal(to_torch(model.joint_anchor0), to_torch(built.joint_anchor0).expand(4, -1, -1))
    task.begin_episodes(torch.tensor([False, True, False, False]))
    after = to_torch(model.joint_anchor1)
    assert (before[:, elbow, 0] != after[:, elbow, 0]).tolist() == [False, True, False, False]


def test_a_robot_leans_on_its_front_feet_by_as_much_as_its_trunk_is_heavier_there():
    """At rest the feet's centre of pressure is below the centre of mass of the whole robot."""
    ranges = {"body_com_x": Range(0.06, 0.06, mode="set", only="trunk")}
    front = {}
    for title, drawn in (("ahead", ranges), ("built", {})):
        task: Any = make("quadruped-velocity", 2, push_speed=0.0, start_angle=0.0, randomise=drawn)
        task.restart(1)
        for _ in range(150):
            task.step(torch.zeros(2, 12))
        mass, place = to_torch(task.simulation.model.body_mass)[0], task.views.body_q[..., :3]
        centre = (place * mass[:, None]).sum(dim=1) / mass.sum()
        force = task.on_feet.force[..., 2:]
        pressure = (task.on_feet.position() * force).sum(dim=1) / force.sum(dim=1)
        # It creeps yet: contacts are at the feet's middles only to a radius times the lean of the shanks
        assert (centre - pressure)[:, :2].norm(dim=1).max() < 0.01
        front[title] = force[:, :2].sum(dim=1) / force.sum(dim=1)
    # 0.06 m of a trunk of 6.9 of 15.2 kg over a distance of 0.39 m between the feet: 7 %, less what it leans by
    assert ((front["ahead"] - front["built"]) > 0.04).all()


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({"body_com_x": Range(0.9, 1.1)}, "a shift starts from 0; use mode='add' or 'set'"),
        ({"body_com_x": Range(0, 0.1, mode="set", when="step")}, "a centre of mass jumps with its body"),
        ({"body_com_y": Range(0, 0.1, mode="set"), "shape_x": Range(1, 1)}, "'shape_x': it follows body_com_y"),
        ({"body_com_y": Range(0, 0.1, mode="set", only="bx")}, "there is no 'bx'; did you mean box"),
        ({"body_com": Range(0, 0.1, mode="set")}, "no model parameter 'body_com'; did you mean body_com_"),
    ],
)  # fmt: skip
def test_what_it_refuses(ranges, message):
    with pytest.raises(InputError, match=message):
        Things(TaskConfig(randomise=ranges), 2)


def test_vehicles_have_places_of_their_own():
    with pytest.raises(InputError, match=r"body_com_x.*of task 'hallway' has places on bodies"):
        make("hallway", 2, obs="state", randomise={"body_com_x": Range(0, 0.1, mode="set")})


@pytest.mark.parametrize("things", [Things, Loose])
def test_a_checkpoint_brings_the_shifts_back(things):
    task = things(TaskConfig(randomise={"body_com_x": Range(-0.05, 0.05, mode="add")}), 3)
    saved = task.state_dict()
    anchors = to_torch(task.simulation.model.joint_anchor1).clone()
    other = things(TaskConfig(randomise={"body_com_x": Range(-0.05, 0.05, mode="add")}), 3, seed=9)
    assert not torch.equal(to_torch(other.simulation.model.joint_anchor1), anchors)
    other.load_state_dict(saved)
    assert torch.equal(to_torch(other.simulation.model.joint_anchor1), anchors)
    for _ in range(5):
        for each in (task, other):
            each.step(torch.zeros(3, 1))
    assert torch.equal(task.views.body_q, other.views.body_q)
