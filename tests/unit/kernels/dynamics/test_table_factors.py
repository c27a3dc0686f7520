"""Laws by table: `joint_stiffness` and `joint_damping` are factors of the table, in each world its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.model.effective_parameters import effective_entries
from tests.reference.step_laws import table_integral, table_value_slope
from tests.unit.kernels.dynamics.test_falling_laws import combination, slide, spring, spring_on_slide

FACTORS = (1.0, 0.5, 2.0, 0.0, 1.3)
LAWS: dict[str, dict[str, Any]] = {
    "spring_table": {"spring_table": ((-1.0, -0.1, 0.0, 1.0), (-200.0, -4.0, 0.0, 80.0)), "damping": 0.3},
    "damper_table": {"damper_table": ((-2.0, 0.0, 2.0), (-8.0, 0.0, 3.0)), "stiffness": 20.0},
    "damper_map": {
        "damper_map": ((-1.0, 1.0), (-1.0, 0.0, 1.0), ((-4.0, -6.0), (0.0, 0.0), (2.0, 5.0))), "stiffness": 20.0,
    },
}  # fmt: skip
PARAMETER = {"spring_table": "joint_stiffness", "damper_table": "joint_damping", "damper_map": "joint_damping"}


def loop(builder: sw.ModelBuilder, body: int, **law: Any) -> None:
    """The law on a joint that closes a loop: a hinge beside a slide's carriage and its arm."""
    slide(builder, body)
    arm = builder.add_body("arm", mass=0.5, inertia=(0.1,) * 3, pose=sw.pose((1, 0, 0)))
    builder.add_joint_revolute("hinge", body, arm, axis=(0, 0, 1), anchor=(1, 0, 0))
    builder.add_joint_prismatic("slot", sw.WORLD, arm, axis=(1, 0, 0), anchor=(1, 0, 0), **law)


def scaled(key: str, law: dict[str, Any], factor: float) -> dict[str, Any]:
    """The law with all efforts of its table times a factor."""
    *places, efforts = law[key]
    return law | {key: (*places, (factor * np.asarray(efforts)).tolist())}


def simulation(attach: Any, law: dict[str, Any], worlds: int, per_world: tuple[str, ...] = ()) -> sw.Simulation:
    builder = sw.ModelBuilder(gravity=(0, 0, 0))
    body = builder.add_body("a", mass=1.0, inertia=(0.1,) * 3, pose=sw.pose((1, 0, 0)), velocity=(1.5, 0, 0))
    attach(builder, body, **law)
    return sw.Simulation(builder.finalize(worlds, "cpu", per_world=per_world), dt=2e-3)


@pytest.mark.parametrize("key", LAWS)
@pytest.mark.parametrize("attach", [slide, spring, spring_on_slide, combination, loop])
def test_a_factor_of_a_world_scales_its_table(attach, key):
    """As a model does that was built with the scaled table."""
    name = PARAMETER[key]
    batch = simulation(attach, LAWS[key], len(FACTORS), (name,))
    parameter = getattr(batch.model, name)
    (column,) = np.nonzero(parameter.numpy()[0])[0].tolist()
    assert effective_entries(batch.model, name).entries[column]
    for world, factor in enumerate(FACTORS):
        parameter[world, column] = factor
    batch.step(100)
    found = batch.state.body_v.numpy()[:, 0, 0]
    assert np.ptp(found) > 0.1
    for world, factor in enumerate(FACTORS):
        alone = simulation(attach, scaled(key, LAWS[key], factor), 1)
        alone.step(100)
        # rounding of the factor into each table's values, over 100 steps of float32
        assert found[world] == pytest.approx(float(alone.state.body_v.numpy()[0, 0, 0]), abs=2e-6)


@pytest.mark.parametrize("factor", [0.25, 1.0, 4.0])
def test_the_frequency_grows_with_the_root_of_the_factor(factor):
    """x = A sin(w t), w^2 = factor k / m, of a table that is straight: A / v = 1 / w at the quarter of the period."""
    law = {"spring_table": ((-1.0, 0.0, 1.0), (-25.0, 0.0, 25.0))}
    sim = simulation(slide, law, 1)
    sim.model.joint_stiffness[0, 0] = factor
    omega = 5.0 * np.sqrt(factor)
    steps = round(0.5 * np.pi / omega / sim.dt)
    sim.step(steps)
    # backward Euler: the share h w^2 / 2 of the amplitude per second, and half a step of phase
    loss = 0.5 * sim.dt * omega**2 * steps * sim.dt
    assert sim.joint_position("j") == pytest.approx(1.5 / omega, rel=loss + 0.5 * sim.dt * omega)
    assert abs(sim.joint_velocity("j")) < 1.5 * omega * sim.dt


@pytest.mark.parametrize("factor", [1.0, 3.0])
@pytest.mark.parametrize("rest", [0.0, 0.07])
def test_energy_holds_what_a_spring_by_table_stores(factor, rest):
    """Over knots, slack and both ends, where the table goes on."""
    table = ((-0.1, -0.02, 0.02, 0.1), (-6.0, 0.0, 0.0, 5.0))
    sim = simulation(slide, {"spring_table": table, "rest": rest}, 1)
    fine = sw.Simulation(sim.model, dt=5e-5)
    fine.model.joint_stiffness[0, 0] = factor
    found, extent = [], []
    for _ in range(40):
        stored = factor * table_integral(table, fine.joint_position("j") - rest)
        speed = float(fine.state.body_v.numpy()[0, 0, 0])
        found.append(float(fine.measure_energy().numpy()[0]))
        assert found[-1] == pytest.approx(0.5 * speed**2 + stored, rel=1e-5)  # float32 velocities
        extent.append(fine.joint_position("j") - rest)
        fine.step(400)
    assert max(extent) > 0.1
    assert min(extent) < -0.1
    # backward Euler damps: the share h w^2 of the energy per second, of the stiffest slope's w^2, for 0.8 s
    slope = factor * table_value_slope(table, -1.0)[1]
    assert found == pytest.approx([found[0]] * len(found), rel=5e-5 * slope * 0.8)
