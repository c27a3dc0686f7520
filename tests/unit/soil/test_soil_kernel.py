"""The kernel of the soil against an independent float64 reference: forces, moments and implicit blocks."""

from __future__ import annotations

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.soil import PRESETS, ShearMemory, Soil, SoilWheel
from tests.reference import soil as reference
from tests.reference.soil_shapes import Body, Wheel

DT = 2e-3
RADIUS, WIDTH, SPACING = 0.467, 0.254, 0.05


def parameters(name: str) -> reference.SoilParameters:
    spec = PRESETS[name]
    return reference.SoilParameters(
        k_phi=spec.k_phi, k_c=spec.k_c, n=spec.exponent, cohesion=spec.cohesion, friction_angle=spec.friction_angle,
        shear_modulus=spec.shear_length, elastic=spec.elastic, damping=spec.damping,
    )  # fmt: skip


def path(seed: int, steps: int) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Places, quaternions, velocities and spins of a wheel that rolls and sinks, steered and leaning a little."""
    rng = np.random.default_rng(seed)
    x = np.array([0.0, 0.0, RADIUS - 0.01])
    turn = np.array([*rng.normal(size=2) * 0.03, rng.normal() * 0.5, 1.0])
    found = []
    for _ in range(steps):
        v = np.array([1.0, 0.0, -0.3]) + rng.normal(size=3) * 0.1
        spin = np.array([0.0, 2.5, 0.0]) + rng.normal(size=3) * 0.2
        found.append((x.copy(), turn / np.linalg.norm(turn), v, spin))
        x = x + DT * 5.0 * v
    return found


@pytest.mark.parametrize("memory", list(ShearMemory))
@pytest.mark.parametrize(("soil", "seed"), [("soft", 1), ("mid", 2), ("hard", 3), ("clay", 4)])
def test_a_wheel_feels_what_the_reference_says(soil, seed, memory):
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    body = builder.add_body("w", mass=1e9, inertia=(1e9, 1e9, 1e9))
    model = builder.finalize(1, "cpu")
    ours = Soil(model, [SoilWheel(body=body, radius=RADIUS, width=WIDTH)], soil, spacing=SPACING, shear_memory=memory)
    simulation = sw.Simulation(model, DT, elements=[ours], threads=1)
    theirs = reference.GridSoil(parameters(soil), SPACING, memory=reference.ShearMemory(memory.value), damp_ahead=False)
    state, control = simulation.state, simulation.control
    wheel = Wheel(RADIUS, WIDTH)
    pressed = 0
    for x, q, v, spin in path(seed, 25):
        state.body_x.assign(x[None, None])
        state.body_rot.assign(q[None, None])
        state.body_v.assign(v[None, None].astype(np.float32))
        state.body_omega.assign(spin[None, None].astype(np.float32))
        simulation.measure()
        simulation.step()
        [known] = theirs.react([Body(wheel, x, matrix_of(q), v, spin)], DT, implicit=True)
        size = float(np.linalg.norm(known.force)) + 10.0
        # 0.25 % at most are seen, where a node whose cell is hardly covered counts in one of the two; else 1e-4
        np.testing.assert_allclose(control.element_force.numpy()[0, 0], known.force, atol=4e-3 * size)
        np.testing.assert_allclose(control.element_torque.numpy()[0, 0], known.moment, atol=4e-3 * RADIUS * size)
        mass, coupling = control.element_mass.numpy()[0, 0], control.element_coupling.numpy()[0, 0]
        block = np.block([[mass, coupling.T], [coupling, control.element_inertia.numpy()[0, 0]]])
        # what a change of velocity in the step takes off the force: the secant of a node that hardly moves is all noise
        change = np.array([0.004, -0.003, 0.005, 0.01, 0.01, -0.01])
        taken, wanted = block @ change / DT, known.matrix @ change / DT
        np.testing.assert_allclose(taken[:3], wanted[:3], atol=4e-3 * size)
        np.testing.assert_allclose(taken[3:], wanted[3:], atol=4e-3 * RADIUS * size)
        pressed += int(ours.touched.numpy()[0, 0] > 5)
    assert pressed > 15
