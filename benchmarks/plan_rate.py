"""How often MPPI plans for a vehicle: 64 samples, 0.8 s ahead, steps of 5 ms, a plan each 0.1 s.

Run: python benchmarks/plan_rate.py sedan hmmwv hmmwv-reduced --threads 2
"""

from __future__ import annotations

import argparse
import time

import torch

import simwarp as sw
from simwarp.planning import Imagination, Mppi, MppiConfig
from simwarp.vehicle import VEHICLE_SOLVER, Vehicle, add_vehicle, load_vehicle, per_world

DT, STEPS, HORIZON = 5e-3, 20, 8
"""Of a step [s]; steps of a control step; control steps ahead."""


class Car:
    """A vehicle at 10 m/s in some worlds."""

    def __init__(self, name: str, worlds: int, threads: int) -> None:
        builder = sw.ModelBuilder()
        parts = add_vehicle(builder, load_vehicle(name), speed=10.0)
        model = builder.finalize(worlds, "cpu", per_world=per_world())
        vehicle = Vehicle(parts, model)
        self.sim = sw.Simulation(model, DT, elements=[vehicle], solver=VEHICLE_SOLVER, threads=threads)
        self.input, self.position = sw.to_torch(vehicle.input), sw.to_torch(vehicle.position)

    def act(self, action: torch.Tensor) -> None:
        """Steering, and one number for both pedals."""
        self.input[:, 0] = action[:, 0]
        self.input[:, 1], self.input[:, 2] = action[:, 1].clamp(min=0.0), (-action[:, 1]).clamp(min=0.0)


def measure(name: str, samples: int, threads: int, plans: int) -> str:
    """A lane change of 3 m, and how long its plans take."""
    real, imagined = Car(name, 1, threads), Car(name, samples, threads)
    imagination = Imagination(real.sim, imagined.sim, act=imagined.act, action_size=2, steps=STEPS)
    config = MppiConfig(horizon=HORIZON, noise=(0.3, 0.3), temperature=1.0)
    planner = Mppi(imagination, lambda sim, action: (imagined.position[:, 1] - 3.0) ** 2, config)
    for _ in range(2):
        real.act(planner.plan())
        real.sim.step(STEPS)
    clock, processor = time.perf_counter(), time.process_time()
    for _ in range(plans):
        real.act(planner.plan())
    clock, processor = (time.perf_counter() - clock) / plans, (time.process_time() - processor) / plans
    steps = samples * HORIZON * STEPS
    times = f"{1e3 * clock:6.0f} ms of clock, {1e3 * processor:6.0f} ms of processor a plan"
    rates = f"{steps / clock:.0f} world-steps/s, {steps / processor:.0f} per second of processor"
    return f"{name:>14}: {times}: {1 / clock:.2f} Hz, {rates}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vehicles", nargs="*", default=["sedan"])
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--plans", type=int, default=10)
    args = parser.parse_args()
    for name in args.vehicles:
        print(measure(name, args.samples, args.threads, args.plans))


if __name__ == "__main__":
    main()
