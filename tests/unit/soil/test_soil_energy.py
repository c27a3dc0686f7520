"""Soil gives no energy: what a wheel loses and what the soil stores elastically never rise together."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.soil import PRESETS, ShearMemory, Soil, SoilBox, SoilSpec, SoilWheel
from simwarp.soil.soil_parameters import DEEP
from simwarp.verify.soil_rigs import yielded_nodes
from tests.reference import soil as reference
from tests.reference.soil_shapes import Body, Wheel
from tests.unit.soil.soil_wheels import GRAVITY

SOILS = ("soft", "mid", "hard")


def parameters(name: str) -> reference.SoilParameters:
    spec = PRESETS[name]
    return reference.SoilParameters(
        k_phi=spec.k_phi, k_c=spec.k_c, n=spec.exponent, cohesion=spec.cohesion, friction_angle=spec.friction_angle,
        shear_modulus=spec.shear_length, elastic=spec.elastic, damping=spec.damping,
    )  # fmt: skip


class Thrown:
    """A wheel of any mass, thrown at the soil with any velocity and spin, leaning a little."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.soil = SOILS[seed % len(SOILS)]
        self.memory = list(ShearMemory)[seed % 2]
        self.radius, self.width = rng.uniform(0.25, 0.55), rng.uniform(0.15, 0.35)
        self.mass = float(np.exp(rng.uniform(np.log(20.0), np.log(800.0))))
        self.inertia = self.mass * self.radius**2 * np.array([0.3, 0.5, 0.3])
        turn = np.array([*rng.normal(size=2) * 0.1, rng.normal(), 1.0])
        turn /= np.linalg.norm(turn)
        builder = sw.ModelBuilder()
        start = sw.pose((*rng.uniform(-0.1, 0.1, size=2), self.radius + 0.1), tuple(turn))
        body = builder.add_body("w", mass=self.mass, inertia=tuple(self.inertia), pose=start)
        model = builder.finalize(1, "cpu")
        wheel = SoilWheel(body=body, radius=self.radius, width=self.width)
        self.element = Soil(model, [wheel], self.soil, shear_memory=self.memory)
        dt = rng.uniform(1e-3, 3e-3)
        self.simulation = sw.Simulation(model, dt, elements=[self.element], threads=1)
        self.simulation.state.body_v.fill_(wp.vec3(*rng.normal(size=3) * (2.0, 1.0, 0.5)))
        self.simulation.state.body_omega.fill_(wp.vec3(*rng.normal(size=3) * (0.5, 6.0, 0.5)))
        self.simulation.measure()

    def energy(self) -> float:
        """Kinetic, of its weight, and stored in nodes below it [J]."""
        state = self.simulation.state
        x, rotation = state.body_x.numpy()[0, 0], matrix_of(state.body_rot.numpy()[0, 0])
        v, omega = (getattr(state, name).numpy()[0, 0].astype(float) for name in ("body_v", "body_omega"))
        rates = omega @ rotation
        kinetic = 0.5 * self.mass * float(v @ v) + 0.5 * float(rates @ (self.inertia * rates))
        store = reference.GridSoil(parameters(self.soil), 0.05)
        store.nodes = {(x, y): memory for (x, y), memory in zip(*yielded_nodes(self.element), strict=True)}
        stored = store.stored(Body(Wheel(self.radius, self.width), x, rotation, v, omega))
        return kinetic + self.mass * GRAVITY * float(x[2]) + stored


def rise(seed: int) -> tuple[float, float]:
    """Greatest rise of the energy above an earlier value, and its whole change, over what there was at first."""
    thrown = Thrown(seed)
    found = [thrown.energy()]
    for _ in range(150):
        thrown.simulation.step(4)
        found.append(thrown.energy())
    energy = np.array(found)
    assert np.isfinite(energy).all()
    # what it had at first above lying at rest on the surface
    first = energy[0] - thrown.mass * GRAVITY * thrown.radius
    rises = energy - np.minimum.accumulate(energy)
    return float(rises.max() / first), float((energy[-1] - energy[0]) / first)


@pytest.mark.parametrize("seed", range(4))
def test_energy_never_rises_by_2_percent_of_the_first(seed):
    risen, change = rise(seed)
    assert risen < 0.02
    assert change < 0.0


@pytest.mark.slow
def test_thirty_random_wheels_gain_nothing():
    risen, change = np.array([rise(seed) for seed in range(100, 130)]).T
    assert risen.max() < 0.02
    assert change.max() < 0.0


@pytest.mark.parametrize(("exponent", "k_c"), [(0.5, 0.0), (1.0, 1e5)])
def test_a_plate_does_not_bounce_higher_than_it_fell_where_loading_is_as_stiff_as_unloading(exponent, k_c):
    """The least elastic stiffness that is taken: at small sinkages Bekker's curve is the stiffer one."""
    k_phi, drop = 2e5, 0.02
    elastic = 1.001 * k_phi * exponent * DEEP ** (exponent - 1.0)
    spec = SoilSpec(k_phi=k_phi, k_c=k_c, exponent=exponent, elastic=elastic, damping=0.0)
    builder = sw.ModelBuilder()
    body = builder.add_body("plate", mass=2000.0, inertia=(200, 200, 400), pose=sw.pose((0.0, 0.0, drop + 0.1)))
    model = builder.finalize(1, "cpu")
    soil = Soil(model, [SoilBox(body=body, half=(0.5, 0.5, 0.1))], spec, spacing=0.05)
    simulation = sw.Simulation(model, 5e-4, elements=[soil], threads=1)
    heights = []
    for _ in range(1000):
        simulation.step()
        heights.append(float(simulation.state.body_x.numpy()[0, 0, 2]) - 0.1)
    lowest = int(np.argmin(heights))
    assert heights[lowest] < -0.05
    assert max(heights[lowest:]) < drop
    assert float(soil.height([(0.0, 0.0)]).numpy()[0, 0]) < 1e-3  # nothing is pushed up
