"""A vehicle that is put somewhere else drives there as it would have driven here."""

from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.vehicle import VEHICLE_SOLVER, Vehicle, add_payload, add_vehicle, per_world, place_vehicle, vehicle_names
from tests.physics.sample_vehicles import shipped

PLACES = np.array([(0.0, 0.0), (30.0, -20.0), (-5.0, 40.0)])
HEADINGS = np.array([0.0, 1.5, -2.5])


class Rolling:
    """Three worlds with a vehicle that rolls at 5 m/s, steers and brakes."""

    def __init__(self, name: str = "hmmwv-reduced", *, load: bool = False) -> None:
        builder = sw.ModelBuilder()
        self.parts = add_vehicle(builder, shipped(name), speed=5.0)
        if load:
            add_payload(builder, self.parts, mass=300.0)
        self.model = builder.finalize(3, "cpu", per_world=per_world())
        self.vehicle = Vehicle(self.parts, self.model)
        self.sim = sw.Simulation(self.model, 2.0e-3, elements=[self.vehicle], solver=VEHICLE_SOLVER)

    def positions(self) -> np.ndarray:
        """(W, B, 3) of all bodies [m]."""
        return self.sim.state.body_x.numpy().copy()


def turned(vectors: np.ndarray, angle: float) -> np.ndarray:
    """Vectors (..., 3) turned about the vertical."""
    c, s = np.cos(angle), np.sin(angle)
    return vectors @ np.array([(c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)]).T


@pytest.mark.parametrize("name", vehicle_names())
def test_all_of_a_vehicle_s_bodies_are_known(name):
    rolling = Rolling(name, load=True)
    assert rolling.vehicle.bodies.numpy()[0] == rolling.parts.chassis
    assert sorted(rolling.vehicle.bodies.numpy()) == list(range(rolling.model.body_count))


def test_it_drives_there_as_it_would_have_driven_here():
    rolling = Rolling(load=True)
    place_vehicle(rolling.sim, rolling.vehicle, PLACES, HEADINGS)
    rolling.vehicle.input[:, 0] = 0.3
    rolling.vehicle.input[:, 2] = 0.2
    rolling.sim.step(400)
    found = rolling.positions()
    for world in (1, 2):
        image = turned(found[0], HEADINGS[world]) + np.append(PLACES[world], 0.0)
        # velocities are float32: their rounding, along other axes, grows a little on the way of 4 m
        assert found[world] == pytest.approx(image, abs=1e-3)


def test_position_heading_and_height_are_those_asked_for():
    rolling = Rolling()
    place_vehicle(rolling.sim, rolling.vehicle, (3.0, 4.0, 7.0), 0.5)
    before = rolling.positions()
    place_vehicle(rolling.sim, rolling.vehicle, (3.0, 4.0), 0.5)
    assert rolling.positions() == pytest.approx(before, abs=1e-12)
    q = rolling.sim.state.body_rot.numpy()[:, rolling.parts.chassis]
    origin = before[:, rolling.parts.chassis] + turned(rolling.parts.reference, 0.5)
    assert 2.0 * np.arctan2(q[:, 2], q[:, 3]) == pytest.approx([0.5] * 3, abs=1e-12)
    assert origin == pytest.approx(np.broadcast_to([3.0, 4.0, 7.0], (3, 3)), abs=1e-12)
    # what viewers and tasks read follows, in float32
    assert rolling.sim.state.body_q.numpy()[:, rolling.parts.chassis, :3] == pytest.approx(before[:, 0], abs=1e-5)


def test_only_the_worlds_of_the_mask_change():
    rolling = Rolling()
    before = rolling.positions()
    place_vehicle(rolling.sim, rolling.vehicle, PLACES + 1.0, HEADINGS, np.array([False, True, False]))
    after = rolling.positions()
    assert (after[[0, 2]] == before[[0, 2]]).all()
    assert (after[1] != before[1]).any()


@pytest.mark.parametrize("kind", ["torch", "warp"])
def test_tensors_and_warp_arrays_do_as_well(kind):
    rolling, same = Rolling(), Rolling()
    values: list[Any] = [torch.as_tensor(PLACES).float(), torch.as_tensor(HEADINGS)]
    if kind == "warp":
        values = [wp.array(PLACES, dtype=wp.vec2d, device="cpu"), wp.array(HEADINGS, dtype=wp.float64, device="cpu")]
    place_vehicle(rolling.sim, rolling.vehicle, *values)
    place_vehicle(same.sim, same.vehicle, PLACES, HEADINGS)
    assert rolling.positions() == pytest.approx(same.positions(), abs=1e-12)


def test_what_cannot_be_meant_is_refused():
    rolling, other = Rolling(), Rolling()
    cases: list[tuple[Any, Any, str]] = [
        ((1.0, np.nan), 0.0, "position must be finite"),
        (np.zeros((2, 3)), 0.0, "position must have shape"),
        (torch.zeros(2, 3), 0.0, "position must have shape"),
        ((0.0, 0.0), [1.0, 2.0], "heading must have shape"),
        ((0.0, 0.0), float("inf"), "heading must be finite"),
    ]
    for position, heading, message in cases:
        with pytest.raises(ModelError, match=f"place_vehicle: {message}.*; give one for all worlds, or one for each"):
            place_vehicle(rolling.sim, rolling.vehicle, position, heading)
    with pytest.raises(
        ModelError, match=r"place_vehicle: world_mask must have shape \(3,\) .*, got \(2,\); give one bool"
    ):
        place_vehicle(rolling.sim, rolling.vehicle, (0.0, 0.0), world_mask=[True, False])
    with pytest.raises(ModelError, match="another model"):
        place_vehicle(rolling.sim, other.vehicle, (0.0, 0.0))
