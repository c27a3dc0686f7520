"""Instances of the page against those that rays meet: places, turns, sizes, colours; layouts and paces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.geometry.visual_mesh import VisualMesh
from simwarp.sensors.cameras.appearance import CheckerTexture
from simwarp.sensors.scene import Visuals

pytest.importorskip("viser")

from simwarp.viewer.live import page_meshes
from simwarp.viewer.live.batches import HIDDEN, Batches, multiplied, turned
from simwarp.viewer.live.body_readback import BodyReadback
from simwarp.viewer.live.world_layout import Layout, natural_layout, offsets
from tests.reference.mechanisms import random_mechanism


def furnished(worlds: int = 3) -> tuple[sw.Simulation, Any]:
    """A tree of bodies with a shape of every kind, moved differently in every world."""
    builder = random_mechanism(2, 4, loops=0)
    rng = np.random.default_rng(1)

    def somewhere() -> sw.Pose:
        return sw.pose(rng.normal(size=3), rng.normal(size=4))

    builder.add_shape_box(0, half=(0.1, 0.2, 0.3), pose=somewhere(), name="box")
    builder.add_shape_capsule(1, radius=0.1, half_length=0.3, pose=somewhere(), name="capsule")
    builder.add_shape_cylinder(2, radius=0.1, half_length=0.4, pose=somewhere(), name="cylinder")
    builder.add_shape_hull(3, rng.normal(size=(12, 3)), pose=somewhere(), name="hull")
    builder.add_shape_plane(pose=sw.pose((0.0, 0.0, -3.0)), name="ground")
    visuals = Visuals(builder)
    visuals.add_cone(0, radius=0.1, half_length=0.2, pose=somewhere(), name="cone", color=(0.2, 0.4, 0.6))
    visuals.add_ellipsoid(sw.WORLD, half=(1.0, 0.5, 0.2), pose=somewhere(), name="egg")
    visuals.add_mesh(1, np.eye(3), np.array([[0, 1, 2]]), name="triangle", scale=(1.0, 2.0, 3.0), pose=somewhere())
    model = builder.finalize(worlds, "cpu")
    scene = visuals.finalize(model, per_world=("x", "color", "enabled"))
    sim = sw.Simulation(model, 1e-3)
    sim.set_joint_state(None, rng.uniform(-0.5, 0.5, (worlds, model.dof_count)), None)
    return sim, scene


def test_instances_are_where_rays_meet_them() -> None:
    sim, scene = furnished()
    tables = scene.tables()
    scene.place(sim.state, tables)
    places, turns = Batches(scene, [2, 0]).poses(BodyReadback(sim.state, np.array([2, 0])))
    for row, world in enumerate((2, 0)):
        expected = tables.place_x.numpy()[world] + tables.origin.numpy()[world]
        # float32 places of rays, at distances of some metres
        np.testing.assert_allclose(places[row], expected, atol=1e-5)
        mine = np.array([matrix_of(turn) for turn in turns[row]])
        np.testing.assert_allclose(mine, tables.place_rot.numpy()[world], atol=1e-6)


HALVES = {
    "box": (0.1, 0.2, 0.3), "capsule": (0.1, 0.1, 0.4), "cylinder": (0.1, 0.1, 0.4), "cone": (0.1, 0.1, 0.2),
    "egg": (1.0, 0.5, 0.2),
}  # fmt: skip
"""What the shapes above reach along their axes [m]."""


def test_scaled_triangles_are_as_large_as_the_shapes() -> None:
    sim, scene = furnished(1)
    tables = scene.tables()
    scene.place(sim.state, tables)
    batches = Batches(scene, [0])
    places, turns = batches.poses(BodyReadback(sim.state, batches.worlds))
    seen = set()
    for batch in batches.batches:
        for row, instance, scale in zip(batch.rows, batch.instances, batch.scales, strict=True):
            name, own = scene.names[instance], batch.mesh.vertices * scale
            corners = places[row, instance] + turned(turns[row, instance], own)
            low, high = (
                array.numpy()[0, instance] + tables.origin.numpy()[0] for array in (tables.lower, tables.upper)
            )
            assert (corners.min(axis=0) >= low - 1e-4).all()
            assert (corners.max(axis=0) <= high + 1e-4).all()
            if name in HALVES:  # circles have 24 sides on the page, balls 80: at most 2 % smaller than they are
                np.testing.assert_allclose(np.abs(own).max(axis=0), HALVES[name], rtol=0.02)
            seen.add(name)
    assert seen == set(scene.names) - {"ground"}


def test_grounds_are_shown_once() -> None:
    _, scene = furnished(3)
    batches = Batches(scene, [0, 1, 2])
    assert [ground.position[2] for ground in batches.grounds] == [-3.0]


def test_what_a_world_changes_is_read_again() -> None:
    _, scene = furnished(2)
    batches = Batches(scene, [0, 1])
    assert not batches.read_scenery()
    egg = scene.instance("egg")
    enabled = scene.enabled.numpy()
    enabled[1, egg] = 0
    scene.enabled.assign(enabled)
    assert batches.read_scenery()
    assert batches.revision == 2
    [batch] = [each for each in batches.batches if egg in each.instances]
    scales = {int(row): scale for row, instance, scale in zip(batch.rows, batch.instances, batch.scales, strict=True)
              if instance == egg}  # fmt: skip
    assert scales[1].max() == HIDDEN
    assert scales[0].max() == 1.0


def test_colours_are_those_of_the_scene() -> None:
    _, scene = furnished(1)
    batches = Batches(scene, [0])
    cone = scene.instance("cone")
    [batch] = [each for each in batches.batches if cone in each.instances]
    expected = [255 * value for value in (0.2, 0.4, 0.6)]  # linear: the page encodes them itself
    np.testing.assert_allclose(batch.colors[list(batch.instances).index(cone)], expected, atol=0.51)


def test_fixed_things_of_one_world_alone_where_worlds_lie_upon_each_other() -> None:
    _, scene = furnished(3)
    egg = scene.instance("egg")
    counts = [
        sum(int((batch.instances == egg).sum()) for batch in Batches(scene, [0, 1, 2], scenery).batches)
        for scenery in (None, 1)
    ]
    assert counts == [3, 1]


def test_quaternions_multiply_as_matrices_do() -> None:
    rng = np.random.default_rng(0)
    a, b = (q / np.linalg.norm(q, axis=-1, keepdims=True) for q in rng.normal(size=(2, 5, 4)))
    for one, two, product in zip(a, b, multiplied(a, b), strict=True):
        np.testing.assert_allclose(matrix_of(product), matrix_of(one) @ matrix_of(two), atol=1e-12)


def test_colours_of_a_mesh_are_kept_at_its_corners() -> None:
    builder = sw.ModelBuilder()
    visuals = Visuals(builder)
    color = np.zeros((2, 3, 3), np.float32)
    color[0], color[1] = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    mesh = VisualMesh(vertices=vertices, triangles=np.array([[0, 1, 2], [0, 2, 3]]), color=color)
    visuals.add_mesh(sw.WORLD, mesh, name="square")
    made = page_meshes.of_mesh(visuals, 0)
    assert made.color is not None
    for face, wanted in zip(made.faces, color, strict=True):
        np.testing.assert_array_equal(made.color[face], wanted)
    assert len(made.vertices) == 6  # the diagonal's corners have two colours


def test_a_checker_has_the_size_of_its_squares() -> None:
    builder = sw.ModelBuilder()
    body = builder.add_body("b", mass=1.0, inertia=(1.0, 1.0, 1.0))
    visuals = Visuals(builder)
    visuals.add_sphere(body, radius=0.1)
    visuals.add_plane(texture=visuals.texture(CheckerTexture(metres=0.25)), color=(1.0, 1.0, 1.0))
    [ground] = Batches(visuals.finalize(builder.finalize(1, "cpu")), [0]).grounds
    assert ground.tile == 0.25


def test_worlds_of_a_grid_do_not_overlap() -> None:
    box = np.repeat(np.array([[[-1.0, -0.5, 0.0], [1.0, 0.5, 1.0]]]), 10, axis=0)
    places = offsets(Layout.GRID, box, box)
    assert np.abs(places.mean(axis=0)[:1]).max() < 2.5
    for one in range(10):
        for other in range(one):
            assert np.abs(places[one] - places[other]).max() >= 2.0
    assert not offsets(Layout.OVERLAY, box, box).any()


def test_grounds_of_a_grid_do_not_overlap_either() -> None:
    """Robots stood to the knee in the height fields of their neighbours: only what moves was set apart."""
    moving = np.repeat(np.array([[[-1.0, -0.5, 0.0], [1.0, 0.5, 1.0]]]), 6, axis=0)
    places = offsets(Layout.GRID, moving, moving * 12.0)
    apart = [np.abs(places[one] - places[other]).max() for one in range(6) for other in range(one)]
    assert min(apart) >= 24.0


@pytest.mark.parametrize(("reach", "layout"), [(2.0, Layout.GRID), (100.0, Layout.ONE)])
def test_what_drives_through_a_country_is_shown_alone(reach: float, layout: Layout) -> None:
    moving = np.array([[[-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]]])
    assert natural_layout(moving, moving * reach) is layout
