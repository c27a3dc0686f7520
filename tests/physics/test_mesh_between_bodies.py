"""Meshes between bodies: the first one holds nodes as its own, further ones by a ball at each."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import simwarp as sw
from tests.physics.mesh_models import RUBBER, momenta, set_motion, simulation

SIZE = (0.06, 0.06, 0.04)


def mount(order=("engine", "base"), worlds=1, base_joint=None, gravity=(0.0, 0.0, -9.81), dt=1e-3):
    """A block of rubber between a base and an engine that it carries; `order` of the bodies it is glued to."""
    builder = sw.ModelBuilder(gravity=gravity)
    base = builder.add_body("base", mass=3.0, inertia=(0.02, 0.02, 0.03), pose=sw.pose((0.0, 0.0, -0.03)))
    engine = builder.add_body("engine", mass=2.0, inertia=(0.01, 0.02, 0.02), pose=sw.pose((0.01, 0.0, 0.07)))
    if base_joint is not None:
        builder.add_joint_fixed("ground", sw.WORLD, base)
    sets = {"engine": "z_max", "base": "z_min"}
    mesh = builder.add_solid_mesh(
        "mount", sw.flex.box(SIZE, (2, 2, 2)), material=RUBBER, glue={name: sets[name] for name in order},
        pose=sw.pose((0.0, 0.0, 0.02)),
    )  # fmt: skip
    return simulation(builder, dt=dt, worlds=worlds), mesh, base, engine


def apart(sim, mesh, body, place):
    """(nodes,) how far nodes are from where they were glued on a body [m]."""
    x, turn = sim.state.body_x.numpy()[0], Rotation.from_quat(sim.state.body_rot.numpy()[0, body])
    local = mesh.points + np.array(place)
    return [np.linalg.norm(x[mesh.bodies[node]] - x[body] - turn.apply(local[node])) for node in ends(mesh, "z_min")]


def ends(mesh, name):
    """Nodes of the lower or upper side."""
    z = mesh.points[:, 2]
    return np.flatnonzero(z == (z.min() if name == "z_min" else z.max()))


def test_an_engine_on_a_mount_rests_as_on_a_fixed_one():
    """A base that stands in the world by a joint is as good as nodes that are fixed in it: balls are exact to 1e-6 m,
    of the 3 mm that it sinks 1e-3.
    """
    sim, mesh, base, engine = mount(base_joint="fixed")
    fixed = sw.ModelBuilder()
    fixed.add_body("base", mass=3.0, inertia=(0.02, 0.02, 0.03), pose=sw.pose((5.0, 0.0, 0.0)))
    other = fixed.add_body("engine", mass=2.0, inertia=(0.01, 0.02, 0.02), pose=sw.pose((0.01, 0.0, 0.07)))
    fixed.add_solid_mesh(
        "mount", sw.flex.box(SIZE, (2, 2, 2)), material=RUBBER, glue={"engine": "z_max"}, fixed="z_min",
        pose=sw.pose((0.0, 0.0, 0.02)),
    )  # fmt: skip
    held = simulation(fixed)
    for _ in range(40):
        sim.step(10)
        held.step(10)
        np.testing.assert_allclose(sim.body_position(engine), held.body_position(other), atol=3e-6)
    assert held.body_position(other)[2] < 0.0695
    assert max(apart(sim, mesh, base, (0.0, 0.0, 0.05))) < 1e-6


@pytest.mark.parametrize("order", [("engine", "base"), ("base", "engine")])
def test_a_free_pair_keeps_its_momenta(order):
    """Thrown and spinning, whichever body is the mesh's own: linear momentum to 1e-6. Bodies that tumble lose angular
    momentum by the order of the step, with or without a mesh (a free one with the engine's inertia 2.6e-4 in this
    time): half of it with half the step, so that balls and glue lose none.
    """
    lost = []
    for dt in (1e-3, 5e-4):
        sim, _, base, engine = mount(order, gravity=(0.0, 0.0, 0.0), dt=dt)
        x = sim.state.body_x.numpy()[0].copy()
        omega = np.zeros_like(x)
        spin = np.array([1.0, -2.0, 3.0])
        omega[[base, engine]] = spin
        set_motion(sim, v=np.array([0.5, -0.3, 0.1]) + np.cross(spin, x - x[base]), omega=omega)
        p0, l0 = momenta(sim)
        sim.step(round(0.3 / dt))
        sim.measure()
        p1, l1 = momenta(sim)
        np.testing.assert_allclose(p1, p0, atol=1e-6 * float(np.linalg.norm(p0)))
        lost.append(np.linalg.norm(l1 - l0) / np.linalg.norm(l0))
    assert lost[0] < 3e-4
    assert lost[0] / lost[1] == pytest.approx(2.0, rel=0.05)


def test_worlds_of_a_mount_are_independent():
    sim, _, _, engine = mount(worlds=4, base_joint="fixed")
    v = sim.state.body_v.numpy()
    v[3, engine] = (0.4, 0.0, 0.0)
    sim.state.body_v.assign(v)
    sim.step(40)
    alone, *_ = mount(worlds=1, base_joint="fixed")
    alone.step(40)
    x = sim.state.body_x.numpy()
    assert (x[:3] == alone.state.body_x.numpy()).all()
    assert np.abs(x[3] - x[0]).max() > 1e-4
