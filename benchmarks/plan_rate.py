"""How often MPPI plans for a vehicle that follows a path: 64 samples, 0.8 s ahead, steps of 5 ms, a plan each 0.1 s.

    python benchmarks/plan_rate.py sedan sedan-14dof --json benchmarks/results/plan_rate.json

Each vehicle drives a double lane change of 3 m at 12 m/s in closed loop, once per number of threads. Vehicles and
threads take turns plan by plan in one process, so that other work takes its time from all of them alike.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
import warp as wp

import simwarp as sw
from simwarp.bench.machine import describe
from simwarp.planning import Imagination, Mppi, MppiConfig
from simwarp.vehicle import VEHICLE_SOLVER, Vehicle, add_vehicle, load_vehicle, per_world

DT: Final = 5e-3
"""Of a step [s]."""
STEPS: Final = 20
"""Of a control step."""
HORIZON: Final = 8
"""Control steps ahead."""
SPEED: Final = 12.0
"""Asked for [m/s]."""
LANES: Final = ((0.0, 0.0), (15.0, 0.0), (40.0, 3.0), (60.0, 3.0), (85.0, 0.0), (200.0, 0.0))
"""The path: x and y of its corners [m], joined by smooth steps."""
UNTIMED: Final = 3
"""First plans, in which kernels are loaded."""


def path_of(x: torch.Tensor) -> torch.Tensor:
    """The path's y at x [m]."""
    y = torch.full_like(x, LANES[0][1])
    for (start, low), (end, high) in itertools.pairwise(LANES):
        share = ((x - start) / (end - start)).clamp(0.0, 1.0)
        y = y + (high - low) * share * share * (3.0 - 2.0 * share)
    return y


class Clocked:
    """Wall and processor time of calls of a function [s]."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function, self.wall, self.cpu = function, 0.0, 0.0

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """What the function returns."""
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            return self.function(*arguments, **options)
        finally:
            self.wall, self.cpu = self.wall + time.perf_counter() - wall, self.cpu + time.process_time() - cpu


class Car:
    """A vehicle on the path, in some worlds."""

    def __init__(self, name: str, worlds: int, threads: int) -> None:
        builder = sw.ModelBuilder()
        parts = add_vehicle(builder, load_vehicle(name), speed=SPEED)
        model = builder.finalize(worlds, "cpu", per_world=per_world())
        vehicle = Vehicle(parts, model)
        self.sim = sw.Simulation(model, DT, elements=[vehicle], solver=VEHICLE_SOLVER, threads=threads)
        self.input, self.position = sw.to_torch(vehicle.input), sw.to_torch(vehicle.position)
        self.velocity = sw.to_torch(vehicle.velocity_b)

    def act(self, action: torch.Tensor) -> None:
        """Steering, and one number for both pedals."""
        self.input[:, 0] = action[:, 0]
        self.input[:, 1], self.input[:, 2] = action[:, 1].clamp(min=0.0), (-action[:, 1]).clamp(min=0.0)

    def cost(self, _: sw.Simulation, action: torch.Tensor) -> torch.Tensor:
        """Of a control step: off the path, off the speed, and of steering."""
        off = self.position[:, 1] - path_of(self.position[:, 0])
        return 2.0 * off**2 + 0.05 * (self.velocity[:, 0] - SPEED) ** 2 + 0.1 * action[:, 0] ** 2


class Drive:
    """A vehicle that is driven by plans on so many threads, and the times of these plans."""

    def __init__(self, name: str, samples: int, threads: int) -> None:
        self.name, self.threads, self.samples = name, threads, samples
        self.real, self.imagined = Car(name, 1, threads), Car(name, samples, threads)
        imagination = Imagination(self.real.sim, self.imagined.sim, act=self.imagined.act, action_size=2, steps=STEPS)
        self.copying, self.stepping = Clocked(imagination.begin), Clocked(self.imagined.sim.step)
        imagination.begin, self.imagined.sim.step = self.copying, self.stepping  # type: ignore[method-assign]
        config = MppiConfig(horizon=HORIZON, noise=(0.15, 0.3), temperature=0.3)
        self.planner = Mppi(imagination, self.imagined.cost, config)
        self.wall: list[float] = []
        self.cpu: list[float] = []
        self.off: list[float] = []

    def turn(self) -> None:
        """A plan, and the control step that it asks for."""
        wall, cpu = time.perf_counter(), time.process_time()
        action = self.planner.plan()
        self.cpu.append(time.process_time() - cpu)
        self.wall.append(time.perf_counter() - wall)
        if len(self.cpu) == UNTIMED:
            self.copying.cpu = self.stepping.cpu = 0.0
        self.real.act(action)
        self.real.sim.step(STEPS)
        self.off.append(float(self.real.position[0, 1] - path_of(self.real.position[:, 0])[0]))

    def figures(self) -> dict[str, Any]:
        """Medians of the plans, in milliseconds; deviations from the path [m]."""
        wall, cpu = 1e3 * np.array(self.wall[UNTIMED:]), 1e3 * np.array(self.cpu[UNTIMED:])
        off = np.array(self.off)
        return {
            "vehicle": self.name, "threads": self.threads, "samples": self.samples, "plans": len(cpu),
            "cpu_ms": round(float(np.median(cpu)), 1),
            "cpu_ms_range": [round(float(x), 1) for x in (min(cpu), max(cpu))],
            "wall_ms": round(float(np.median(wall)), 1),
            "wall_ms_range": [round(float(x), 1) for x in (min(wall), max(wall))],
            "in_100_ms": round(float(np.mean(wall < 100.0)), 3),
            "mean_cpu_ms_physics": round(1e3 * self.stepping.cpu / len(cpu), 1),
            "mean_cpu_ms_copies": round(1e3 * self.copying.cpu / len(cpu), 2),
            "mean_cpu_ms_rest": round(float(cpu.mean()) - 1e3 * (self.stepping.cpu + self.copying.cpu) / len(cpu), 1),
            "off_path_rms_m": round(float(np.sqrt(np.mean(off**2))), 3),
            "off_path_most_m": round(float(np.abs(off).max()), 3),
            "way_m": round(float(self.real.position[0, 0]), 1),
        }  # fmt: skip


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vehicles", nargs="*", default=["sedan", "sedan-14dof"])
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--threads", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--plans", type=int, default=60)
    parser.add_argument("--json", type=Path, help="file of the figures")
    args = parser.parse_args()
    drives = [Drive(name, args.samples, threads) for name in args.vehicles for threads in args.threads]
    for _ in range(args.plans + UNTIMED):
        for drive in drives:
            drive.turn()
    first, rows = np.array(drives[0].cpu[UNTIMED:]), []
    for drive in drives:
        share = float(np.median(np.array(drive.cpu[UNTIMED:]) / first))
        rows.append(row := drive.figures() | {"cpu_over_first": round(share, 3)})
        print(", ".join(f"{key} {value}" for key, value in row.items()))
    if args.json is not None:
        args.json.write_text(
            json.dumps({"machine": describe(wp.get_device("cpu")), "rows": rows}, indent=2) + "\n", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
