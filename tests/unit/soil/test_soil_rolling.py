"""Driven wheels against quadrature along their contact, pull over slip, and wheels in ruts."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simwarp.soil import PRESETS, PressureNormal, ShearMemory
from simwarp.verify.soil_rigs import LOAD, RADIUS, SPEED, WIDTH, DrivenWheel, driven_wheels, repeated_passes
from tests.reference import soil as reference
from tests.reference.soil_quadrature import Rolling, rolling, rolling_along_surface
from tests.reference.soil_shapes import Wheel

SLIPS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6)
LOADS = (2000.0, 4000.0, LOAD)
QUIET = {name: dataclasses.replace(PRESETS[name], damping=0.0) for name in ("soft", "mid", "hard")}


def quadrature(soil: str, load: float, slip: float, memory: ShearMemory) -> Rolling:
    parameters = dataclasses.replace(reference.PRESETS[soil], damping=0.0)
    scalar = memory is ShearMemory.SCALAR
    memories = reference.SCALAR if scalar else reference.DIRECTION
    return rolling(Wheel(RADIUS, WIDTH), parameters, load, slip, memories, math.inf if scalar else SPEED)


@pytest.mark.parametrize("memory", list(ShearMemory))
def test_driven_wheels_on_fine_nodes_agree_with_quadrature(memory):
    """To 2 % at nodes of 2 cm, of slips above 0.1, where pull is more than the difference of two large shears."""
    slips = (0.1, 0.4)
    found = driven_wheels([DrivenWheel(slip=slip, soil=QUIET["mid"]) for slip in slips], 0.02, "cpu", memory)
    for index, slip in enumerate(slips):
        known = quadrature("mid", LOAD, slip, memory)
        assert found.sinkage[index] == pytest.approx(known.sinkage, rel=0.02)
        assert found.pull[index] == pytest.approx(known.pull, rel=0.02)
        assert found.torque[index] == pytest.approx(known.torque, rel=0.02)


def test_pressure_along_the_surface_agrees_with_quadrature():
    """To 3 % at nodes of 2 cm: the steepest nodes, ahead, count for the most."""
    slips = (0.1, 0.4)
    wheels = [DrivenWheel(slip=slip, soil=QUIET["mid"]) for slip in slips]
    found = driven_wheels(wheels, 0.02, "cpu", normal=PressureNormal.SURFACE)
    for index, slip in enumerate(slips):
        known = rolling_along_surface(
            Wheel(RADIUS, WIDTH), dataclasses.replace(reference.PRESETS["mid"], damping=0.0), LOAD, slip
        )
        assert found.sinkage[index] == pytest.approx(known.sinkage, rel=0.03)
        assert found.pull[index] == pytest.approx(known.pull, rel=0.03)
        assert found.torque[index] == pytest.approx(known.torque, rel=0.03)


@pytest.mark.parametrize("soil", ["soft", "mid"])
def test_compaction_resists_a_wheel_without_shear_by_bekkers_formula(soil):
    """b k z^(n+1) / (n + 1), less what the elastic rebound behind the axle gives back; along the ground's normal none.
    Sums over nodes of 2 cm are within 2 % of it.
    """
    smooth = dataclasses.replace(QUIET[soil], friction_angle=1e-6, cohesion=0.0)
    for normal in PressureNormal:
        found = driven_wheels([DrivenWheel(slip=0.0, soil=smooth)], 0.02, "cpu", normal=normal)
        z, spec = float(found.sinkage[0]), smooth
        bottom = spec.k_phi * z**spec.exponent
        resistance = WIDTH * (bottom * z / (spec.exponent + 1.0) - 0.5 * bottom**2 / spec.elastic)
        wanted = -resistance / LOAD if normal is PressureNormal.SURFACE else 0.0
        assert found.pull[0] == pytest.approx(wanted, rel=0.02, abs=1e-3)
        # the axle of a wheel that is pressed along its radii feels no torque
        if normal is PressureNormal.SURFACE:
            assert found.torque[0] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("memory", ShearMemory)
def test_pull_over_slip_of_three_soils_under_three_loads(memory):
    cases = [(soil, load, slip) for soil in QUIET for load in LOADS for slip in SLIPS]
    wheels = [DrivenWheel(slip=slip, soil=QUIET[soil], load=load) for soil, load, slip in cases]
    found = driven_wheels(wheels, 0.05, "cpu", memory)
    known = [quadrature(*case, memory) for case in cases]
    shape = (len(QUIET), len(LOADS), len(SLIPS))
    pull = found.pull.reshape(shape)
    assert (np.diff(pull, axis=2) > 0.0).all()
    for soil, each in zip(QUIET, pull, strict=True):
        if PRESETS[soil].cohesion == 0.0:
            assert each.max() < math.tan(PRESETS[soil].friction_angle)
    off = np.abs(pull - np.reshape([each.pull for each in known], shape))
    # nodes every 5 cm of a contact of 0.1 to 0.6 m; at small slips shear turns round within it, between two nodes
    assert off[:, :, :2].max() < 0.05
    assert off[:, :, 2:].max() < 0.025
    torque = np.abs(found.torque - [each.torque for each in known])
    assert torque.max() < 0.03
    sinkage = found.sinkage.reshape(shape) / np.reshape([each.sinkage for each in known], shape) - 1.0
    assert np.abs(sinkage[:2]).max() < 0.08
    # 7 mm on hard soil touch 0.16 m of ground, three nodes: the wheel rides up and down on them
    assert np.abs(sinkage[2]).max() < 0.25


@pytest.mark.parametrize("soil", ["soft", "mid", "hard"])
def test_ten_passes_deepen_a_rut_less_and_less(soil):
    depths = np.array([float(depth.max()) for _, depth in repeated_passes(PRESETS[soil], 10, 0.05, "cpu")])
    gains = np.diff(depths, prepend=0.0)
    assert (gains > 0.0).all()
    assert (np.diff(gains) < 0.0).all()
    # and the rut is as wide as the wheel, on rows of 5 cm, its sides as deep as its middle
    across, depth = repeated_passes(PRESETS[soil], 1, 0.05, "cpu")[0]
    assert across[-1] - across[0] == pytest.approx(WIDTH, abs=0.051)
    np.testing.assert_allclose(depth, depth.max(), rtol=1e-3)
