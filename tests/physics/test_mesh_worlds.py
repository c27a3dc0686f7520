"""Meshes in worlds, beside other meshes, in snapshots and far from the origin."""

from typing import Any

import numpy as np
import pytest

import simwarp as sw
from tests.physics.mesh_models import RUBBER, SIZE, simulation
from tests.physics.test_mesh_mechanisms import NYLON, chain, link, sheet

SURFACE = sw.Material(friction=0.5)
BOX = sw.flex.box(SIZE, (2, 2, 2))


def scene(origin=(0.0, 0.0, 0.0)):
    """A hinged pair of bodies with a block below one and a sheet at the other falls on a floor; its two meshes."""

    def at(*place):
        return tuple(np.add(origin, place))

    builder = sw.ModelBuilder()
    builder.add_shape_plane(material=SURFACE)
    plate, arm = link(builder, "plate", at(0.0, 0.0, 0.2)), link(builder, "arm", at(0.2, 0.0, 0.25))
    builder.add_joint_revolute("hinge", plate, arm, axis=(0.0, 1.0, 0.2), anchor=at(0.1, 0.0, 0.22))
    options: dict[str, Any] = {"radius": 2e-3, "surface": SURFACE}
    block = builder.add_solid_mesh(
        "block", BOX, material=RUBBER, glue={plate: "z_max"}, pose=sw.pose(at(0.0, 0.0, 0.06)), **options
    )
    points, triangles, side = sheet()
    flag = builder.add_shell(
        "flag", points, triangles, thickness=2e-3, material=NYLON, glue={arm: side}, pose=sw.pose(at(0.25, 0.0, 0.3)),
        **options,
    )  # fmt: skip
    return builder, block, flag


def stiffer(sim, world, factor=2.0):
    young = sim.model.flexible_young.numpy()
    young[world] *= factor
    sim.model.flexible_young.assign(young)


def places(sim):
    return sim.state.body_x.numpy().copy()


def test_worlds_of_any_number_move_with_the_same_bits():
    """1, 2 and 17 worlds, of which the fourth is stiffer: that one moves as a world alone of that stiffness."""
    found = {}
    for worlds in (1, 2, 17):
        sim = simulation(scene()[0], worlds=worlds, per_world=["flexible_young"])
        if worlds > 3:
            stiffer(sim, 3)
        sim.step(200)
        found[worlds] = places(sim)
        assert sim.contacts.contact_count.numpy().min() > 0
    alone = simulation(scene()[0])
    stiffer(alone, slice(None))
    alone.step(200)
    for worlds, x in found.items():
        for world in range(worlds):
            assert (x[world] == (places(alone) if world == 3 else found[1])[0]).all()
    assert np.abs(found[17][3] - found[1][0]).max() > 1e-4


def test_masked_resets_and_snapshots_continue_with_the_same_bits():
    sim = simulation(scene()[0], worlds=5, per_world=["flexible_young"])
    stiffer(sim, 3)
    sim.step(200)
    before = places(sim)
    sim.reset(np.array([False, True, False, True, False]))
    assert (places(sim)[[0, 2, 4]] == before[[0, 2, 4]]).all()
    kept = sim.snapshot()
    sim.step(200)
    after = places(sim)
    assert (after[[1, 3]] == before[[1, 3]]).all()
    sim.restore(kept)
    sim.step(200)
    assert (places(sim) == after).all()


def test_a_mesh_among_others_out_of_touch_moves_as_it_does_alone():
    """Free, sheets, and on a mechanism: other columns of the matrix add nothing, not even rounding."""

    def fall(others):
        builder = chain()[0] if others else sw.ModelBuilder()
        builder.gravity = np.array([0.0, 0.0, -9.81])
        builder.add_shape_plane(material=SURFACE)
        if others:
            builder.add_solid_mesh("other", BOX, material=NYLON, pose=sw.pose((0.0, 5.0, 0.05)), radius=2e-3)
        mesh = builder.add_solid_mesh("block", BOX, material=RUBBER, pose=sw.pose((9.0, 0.0, 0.05)), radius=2e-3)
        if others:
            points, triangles, side = sheet()
            builder.add_shell(
                "sheet", points, triangles, thickness=1e-3, material=NYLON, fixed=side, pose=sw.pose((3.0, 0.0, 2.0))
            )
        sim = simulation(builder)
        sim.step(300)
        return sw.flex.mesh_positions(sim, mesh).numpy(), sim.contacts.contact_count.numpy()[0]

    alone, contacts = fall(False)
    assert contacts == 9
    assert (fall(True)[0] == alone).all()


def test_ten_kilometres_from_the_origin():
    """Through the first contacts: what float64 leaves of 10 km, 2e-12 m, grows with the impact; 1e-3 of the way is
    asked for.
    """
    tracks = []
    for origin in ((0.0, 0.0, 0.0), (1e4, -1e4, 0.0)):
        builder, block, flag = scene(origin)
        sim, track = simulation(builder), []
        for _ in range(20):
            sim.step(10)
            track.append(np.concatenate([sw.flex.mesh_positions(sim, mesh).numpy()[0] for mesh in (block, flag)]))
        assert sim.contacts.contact_count.numpy()[0] > 0
        tracks.append(np.array(track) - origin)
    moved = np.abs(tracks[0] - tracks[0][0]).max()
    assert np.abs(tracks[1] - tracks[0]).max() < 1e-3 * moved


@pytest.mark.parametrize("kind", ["solid", "sheet"])
def test_single_and_double_precision_agree(kind):
    """Half a second of a swing: float32 factors change a velocity by 1e-6 of what a step changes it by."""
    found = []
    for double in (False, True):
        builder = sw.ModelBuilder()
        arm = link(builder, "arm", (0.0, 0.0, 0.0))
        builder.add_joint_revolute("hinge", sw.WORLD, arm, axis=(0.0, 1.0, 0.0), anchor=(-0.1, 0.0, 0.0))
        if kind == "solid":
            mesh = builder.add_solid_mesh(
                "mesh", BOX, material=RUBBER, glue={arm: "x_min"}, pose=sw.pose((0.1, 0.0, 0.0)), double=double
            )
        else:
            points, triangles, side = sheet()
            mesh = builder.add_shell(
                "mesh", points, triangles, thickness=5e-3, material=NYLON, glue={arm: side},
                pose=sw.pose((0.05, 0.0, 0.0)), double=double,
            )  # fmt: skip
        sim = simulation(builder)
        sim.step(500)
        found.append(sw.flex.mesh_positions(sim, mesh).numpy())
    assert np.abs(found[0] - found[1]).max() < 1e-5
