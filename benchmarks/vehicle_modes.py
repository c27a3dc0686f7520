"""Modes of a full vehicle on its tires, without dampers: `python benchmarks/vehicle_modes.py [NAME]`."""

from __future__ import annotations

import sys

import numpy as np

import simwarp as sw
from simwarp.analysis import Modes, linearise, modes
from simwarp.vehicle import VEHICLE_SOLVER, Vehicle, add_vehicle, load_vehicle, per_world, with_options


def standing_modes(name: str) -> Modes:
    """Modes of a vehicle that has settled for three seconds with its brakes on."""
    spec = with_options(load_vehicle(name), tire="tmeasy", powertrain="simplemap", driveline="4wd")
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, spec)
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model)
    simulation = sw.Simulation(model, 1e-3, elements=[vehicle], solver=VEHICLE_SOLVER)
    inputs = vehicle.input.numpy()
    inputs[:, 2] = 1.0
    vehicle.input.assign(inputs)
    simulation.step(3000)
    return modes(linearise(simulation, inputs=()), damped=False)


def main() -> None:
    """Print the frequency of each mode, and how the first body moves in it."""
    found = standing_modes(sys.argv[1] if len(sys.argv) > 1 else "hmmwv")
    print(f"{len(found.linearisation.coordinates)} free coordinates of {len(found.linearisation.all_coordinates)}")
    with np.printoptions(precision=3, suppress=True):
        for index, frequency in enumerate(found.frequency):
            if frequency > 0.0:
                print(f"{frequency:9.3f} Hz  chassis {found.bodies(index)[0].real}")


if __name__ == "__main__":
    main()
