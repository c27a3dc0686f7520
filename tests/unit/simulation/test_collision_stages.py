"""Collision stage by stage, as a GPU runs it, against collision in one kernel: the same functions, so the same bits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes
from simwarp.kernels.collision.contact_lists import make_lists
from simwarp.kernels.collision.placement import make_collision_scratch
from simwarp.simulation import world_launches
from simwarp.simulation.stage_recording import record_collision
from simwarp.simulation.state import Contacts
from simwarp.simulation.step_sizes import collision_sizes, list_sizes
from simwarp.simulation.world_launches import WorldShares

pytestmark = pytest.mark.slow  # the parts compile for half a minute

WORLDS = 6
CORNERS = np.array([[-1, -1, -1], [1, -1, -0.8], [0.2, 1, -1], [0, 0.1, 1.2], [-0.7, 0.6, 0.4]], float) * 0.2


def soup(ground: Callable[[sw.ModelBuilder], None], seed: int = 5, each: int = 2) -> sw.ModelBuilder:
    """Bodies of all convex shapes that fall onto a ground, and onto each other."""
    builder, rng = sw.ModelBuilder(), np.random.default_rng(seed)
    ground(builder)
    for index in range(7 * each):
        q = rng.normal(size=4)
        x = (*rng.uniform(-0.5, 0.5, 2), 0.4 + 0.25 * index / each)
        body = builder.add_body(
            f"b{index}", mass=1.0, inertia=(0.02, 0.02, 0.02), pose=sw.pose(x, q / np.linalg.norm(q))
        )
        kind = index % 7
        if kind == 0:
            builder.add_shape_sphere(body, radius=0.2)
        elif kind == 1:
            builder.add_shape_capsule(body, radius=0.1, half_length=0.2)
        elif kind == 2:
            builder.add_shape_cylinder(body, radius=0.2, half_length=0.1)
        elif kind == 3:
            builder.add_shape_box(body, half=(0.2, 0.15, 0.1))
        elif kind == 4:
            builder.add_shape_ellipsoid(body, half=(0.2, 0.15, 0.1))
        elif kind == 5:
            builder.add_shape_cone(body, radius=0.2, half_length=0.2)
        else:
            builder.add_shape_hull(body, CORNERS)
    return builder


def plane(builder: sw.ModelBuilder) -> None:
    builder.add_shape_plane()


def field(builder: sw.ModelBuilder) -> None:
    heights = 0.1 * np.random.default_rng(1).uniform(size=(17, 17))
    builder.add_shape_height_field(sw.WORLD, heights, size=(4.0, 4.0))


def mesh(builder: sw.ModelBuilder) -> None:
    x, y = np.meshgrid(np.linspace(-2.0, 2.0, 12), np.linspace(-2.0, 2.0, 12))
    vertices = np.stack([x, y, 0.2 * np.sin(3.0 * x) * np.cos(2.0 * y)], axis=-1).reshape(-1, 3)
    i = np.arange(144).reshape(12, 12)
    a, b, c, d = (part.reshape(-1) for part in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    builder.add_shape_mesh(sw.WORLD, vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def all_grounds(builder: sw.ModelBuilder) -> None:
    plane(builder)
    field(builder)
    mesh(builder)


MODELS: dict[str, tuple[Callable[[], sw.ModelBuilder], int | None]] = {
    "ant": (scenes.ant, None),
    "stack": (lambda: scenes.stack(count=3), None),
    "plane": (lambda: soup(plane), None),
    "field": (lambda: soup(field), None),
    "mesh": (lambda: soup(mesh), None),
    "all grounds": (lambda: soup(all_grounds), None),
    "grid": (lambda: soup(plane, each=10), None),
    "few slots": (lambda: soup(field), 20),
}


def in_parts(sim: sw.Simulation, contacts: Contacts) -> list[world_launches.WorldLaunch]:
    """The parts for the worlds of a simulation, with contacts of their own."""
    shares = WorldShares(WORLDS, 1, sim.model.device)
    assert shares.own_slots
    scratch = make_collision_scratch(sim.model.device, WORLDS, collision_sizes(sim.model))
    return record_collision(
        shares, sim.model, config=sim._config, state=sim.state.arrays, contacts=contacts.arrays, scratch=scratch,
        lists=make_lists(sim.model.device, WORLDS, list_sizes(sim.model, own_slots=True)),
    )  # fmt: skip


@pytest.mark.parametrize("name", MODELS)
def test_the_same_contacts(name, monkeypatch):
    build, slots = MODELS[name]
    model = build().finalize(WORLDS, "cpu", contact_capacity=slots)
    sim = sw.Simulation(model, 4e-3, threads=1)
    (whole,) = [command for command in sim.physics_commands if command.kernel.key.endswith("collide_worlds")]
    contacts = Contacts(model)
    monkeypatch.setattr(world_launches, "has_own_slots", lambda device: True)
    parts = in_parts(sim, contacts)
    rng = np.random.default_rng(2)
    sim.state.body_v.assign(rng.normal(size=(*sim.state.body_v.shape, 3)).astype(np.float32))
    most = lost = 0
    for _ in range(60):
        sim.advance(3)
        contacts.copy_from(sim.contacts)
        whole.launch()
        for part in parts:
            part.launch()
        most = max(most, int(sim.contacts.contact_count.numpy().max()))
        lost += int(sim.contacts.contact_overflow.numpy().sum())
        count = sim.contacts.contact_count.numpy()
        for key in contacts.NAMES:
            expected, found = getattr(sim.contacts, key).numpy(), getattr(contacts, key).numpy()
            if expected.ndim > 1 and expected.shape[1] == model.contact_capacity:
                for world in range(WORLDS):
                    np.testing.assert_array_equal(
                        found[world, : count[world]], expected[world, : count[world]], err_msg=key
                    )
            else:
                np.testing.assert_array_equal(found, expected, err_msg=key)
    assert most > 3
    assert (lost > 0) == (slots is not None)


def test_only_the_parts_that_a_model_needs(monkeypatch):
    monkeypatch.setattr(world_launches, "has_own_slots", lambda device: True)

    def kernels(name: str) -> list[str]:
        model = MODELS[name][0]().finalize(WORLDS, "cpu")
        sim = sw.Simulation(model, 1e-3)
        return [command.kernel.key.rpartition("__")[2] for command in in_parts(sim, Contacts(model))]

    ends = ["place_shapes", "keep_contacts"]
    formula = ["collide_simple_pairs"]
    searched = ["list_pairs", "search_pairs", "clip_pairs"]
    triangles = ["list_triangles", "search_triangles", "clip_triangles", "drop_invalid", "join_triangles"]
    assert kernels("ant") == [ends[0], *formula, ends[1]]
    assert kernels("stack") == [ends[0], *formula, *searched, ends[1]]
    assert kernels("mesh") == [ends[0], *formula, *searched, *triangles, ends[1]]


def test_pairs_are_counted_by_the_way_that_they_are_found():
    builder = soup(all_grounds, each=1)
    topology = builder.finalize(1, "cpu").topology
    assert topology.formula_pairs == 7 + 2  # on the plane; sphere and capsule, sphere and box
    assert topology.searched_pairs == 7 * 6 // 2 - 2
    assert topology.ground_pairs == 2 * 7
