"""What belts lose: on teeth beside runs shoe by shoe, in themselves by formula, and to soil by the work it takes."""

import dataclasses

import numpy as np
import pytest

from simwarp.soil.soil_parameters import soil_preset
from simwarp.vehicle import BeltParameter
from simwarp.vehicle.spec.belt_parts import belt_of
from simwarp.vehicle.tracks.belt_construction import belt_inertia
from simwarp.vehicle.tracks.belt_losses import gap_loss
from simwarp.vehicle.tracks.belt_path import rest_belt, running_radius
from tests.unit.vehicle.tracks.belt_vehicles import M113, drive, evaluate, vehicle

LOSSLESS = {"dry_loss": 0.0, "rolling_loss": 0.0, "square_loss": 0.0}


def gap_loss_of(friction, **law):
    track = belt_of(M113.left, **law)
    track = dataclasses.replace(track, sprocket=dataclasses.replace(track.sprocket, friction=friction))
    return gap_loss(track, rest_belt(track))


@pytest.mark.parametrize(("friction", "measured"), [(0.1, 2770.0 / 169.7e3), (0.4, 9394.0 / 166.0e3)])
def test_teeth_lose_what_they_do_shoe_by_shoe(friction, measured):
    """The M113 at 2 m/s on teeth, less the same on teeth without friction [N], over the tension of both chains [N]."""
    assert gap_loss_of(friction) == pytest.approx(measured, rel=0.1)


def test_nothing_slides_without_friction_or_without_teeth():
    assert gap_loss_of(0.0) == 0.0
    assert gap_loss_of(0.4, smooth_sprocket=True) == 0.0
    assert 0.0 < gap_loss_of(0.05) < gap_loss_of(0.1) < gap_loss_of(0.2)


def test_a_smooth_sprocket_runs_at_its_own_radius():
    """Pins of shoes on a drum are as far from its axis as their path, less than the pitch radius."""
    track, toothed = belt_of(M113.left, smooth_sprocket=True), belt_of(M113.left)
    resting = rest_belt(track)
    assert running_radius(track, resting) == resting.radii[0]
    assert running_radius(toothed, resting) == pytest.approx(10 * 0.154 / (2.0 * np.pi), rel=1e-12)
    own = 0.4 + 0.883
    ratio = (resting.radii[0] / running_radius(toothed, resting)) ** 2
    assert belt_inertia(track) - own == pytest.approx(ratio * (belt_inertia(toothed) - own), rel=1e-12)


def test_resistance_is_the_sum_of_its_parts():
    """Driven at 2 m/s and more; the sprocket's part goes with the mean tension of its two runs."""
    law = {"sprocket_loss": 0.04, "dry_loss": 0.003, "rolling_loss": 0.02, "linear_loss": 0.006, "square_loss": 1e-3}
    sim, parts, belts = vehicle(law=law)
    sim.step(1500)
    drive(sim, parts, 4000.0, 4000.0)
    sim.step(1500)
    evaluate(sim, belts)
    tension, speed, traction, load = (
        getattr(belts, name).numpy()[0].astype(float) for name in ("tension", "speed", "traction", "load")
    )
    assert speed.min() > 1.0
    assert traction.min() > 1e3
    dry = 0.003 * tension + 0.02 * load.sum(axis=1) + 0.04 * (tension - 0.5 * traction)
    expected = -(dry + tension * (0.006 * speed + 1e-3 * speed**2))
    np.testing.assert_allclose(belts.resistance.numpy()[0], expected, rtol=1e-4)


def pressures(soil, patch, depth, height):
    stiffness = soil.k_c / patch + soil.k_phi
    return [stiffness * max(z, 0.0) ** soil.exponent for z in (depth, depth - height)]


@pytest.mark.parametrize("depth", [0.01, 0.05])
def test_pads_press_soil_and_those_at_the_sides_from_their_height_on(depth):
    """Wheels that do not sink into the belt, at a depth above and below the side pads: 0.11 m of a pitch of 0.154 m,
    0.19 m wide, and beside that 0.1315 m of 0.3791 m, 0.02 m higher. Newton's steps leave less than a hundredth."""
    soil = soil_preset("clay")
    sim, parts, belts = vehicle(soil=soil, law={"wheel_sink": 0.0})
    p = belts.parameter.numpy()[0, 0].astype(float)
    middle, side = 0.11 * 0.19 / 0.154, (0.1315 * 0.3791 - 0.11 * 0.19) / 0.154
    assert p[BeltParameter.WIDTH] == pytest.approx(middle, rel=1e-6)
    assert p[BeltParameter.SIDE_WIDTH] == pytest.approx(side, rel=1e-3)
    assert p[BeltParameter.SIDE_HEIGHT] == pytest.approx(0.02, rel=1e-6)
    assert p[BeltParameter.PATCH] == pytest.approx(0.11 * 0.19 / 0.30, rel=1e-6)
    x = sim.state.body_x.numpy().copy()
    x[0, parts.chassis, 2] += -0.62 + 0.215 + 0.335 + 0.03 - depth
    sim.state.body_x.assign(x)
    evaluate(sim, belts, times=30)
    wheels = belts._tables.kind.numpy()[0] == 1
    spacing = np.linalg.norm(np.diff(belts.point_arm.numpy()[0, 0], axis=0), axis=1)
    length = 0.5 * (np.append(spacing, 0.0) + np.insert(spacing, 0, 0.0))
    deep, beside = pressures(soil, p[BeltParameter.PATCH], depth, 0.02)
    force = belts.point_force.numpy()[0, 0, :, 2]
    expected = length * (middle * deep + side * beside)
    np.testing.assert_allclose(force[wheels][1:-1], expected[wheels][1:-1], rtol=1e-2)


@pytest.mark.parametrize("preset", ["mid", "clay"])
def test_soil_takes_the_work_of_pressing_it(preset):
    """Rolling freely without losses of its own, a vehicle is held back by the work per metre that pressing the soil to
    the depth of its ruts takes, less what is elastic, and more for what damps and for shear at the points: a fifth."""
    soil = dataclasses.replace(soil_preset(preset), damping=0.0)
    sim, parts, belts = vehicle(soil=soil, law=LOSSLESS)
    sim.step(2000)
    drive(sim, parts, 2253.0, 2253.0)
    sim.step(2500)
    drive(sim, parts, 0.0, 0.0)
    sim.step(200)
    drags, works = [], []
    p = belts.parameter.numpy()[0, 0].astype(float)
    stiffness, n = soil.k_c / p[BeltParameter.PATCH] + soil.k_phi, soil.exponent
    layers = ((p[BeltParameter.WIDTH], 0.0), (p[BeltParameter.SIDE_WIDTH], p[BeltParameter.SIDE_HEIGHT]))
    for _ in range(40):
        sim.step(10)
        drags.append(-belts.force.numpy()[0, :, 0].sum())
        deepest = belts.memory["sinkage"].numpy()[0].max(axis=1)
        works.append(sum(
            width * stiffness * max(z - height, 0.0) ** (n + 1.0) / (n + 1.0)
            for z in deepest for width, height in layers
        ))  # fmt: skip
    assert np.mean(drags) == pytest.approx(np.mean(works), rel=0.2)
