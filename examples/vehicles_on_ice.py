"""A thousand trucks brake on ice, on wet and on dry roads, each with a load, tires and a driver of its own.

Every world has its own friction, load (mass and place), tire stiffness, and gains of the driver who keeps the lane and
releases the brakes where wheels slip. The figure shows their ways and stopping distances.

Run: python examples/vehicles_on_ice.py --worlds 1000 --plot vehicles_on_ice.png
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import torch

import simwarp as sw
from simwarp import to_torch
from simwarp.vehicle import (
    PAYLOAD,
    VEHICLE_SOLVER,
    CommonTire,
    Payload,
    Tires,
    TmeasyTire,
    Vehicle,
    add_payload,
    add_vehicle,
    load_vehicle,
    per_world,
    set_payload,
)

ROADS = {"ice": (0.1, 0.2), "wet": (0.4, 0.6), "dry": (0.75, 0.9)}
COLORS = {"ice": "#4a90d9", "wet": "#2a9d6f", "dry": "#d9822b"}
BRAKES_AT = 1.0
"""Time at which the driver begins to brake [s]."""


class LaneKeeper:
    """Steers back to y = 0; brakes fully, but less where a wheel slips by more than 10 %. Gains (W, 3): steering per
    metre and per radian, release of the brakes per slip.
    """

    def __init__(self, sim: sw.Simulation, vehicle: Vehicle, gains: np.ndarray) -> None:
        # tensors over the memory that the kernels read and write
        self.input, self.slip = to_torch(vehicle.input), to_torch(vehicle.tires.slip_ratio)
        self.position, self.angles = to_torch(vehicle.position), to_torch(vehicle.angles)
        self.time = to_torch(sim.state.world_time)
        self.aside, self.turned, self.release = torch.as_tensor(gains, dtype=torch.float32, device=self.input.device).T

    def drive(self) -> None:
        """Writes the inputs of the next step, in all worlds at once."""
        y, yaw = self.position[:, 1].float(), self.angles[:, 2]
        self.input[:, 0] = (-self.aside * y - self.turned * yaw).clamp(-1.0, 1.0)
        worst = (-self.slip).amax(dim=1)
        braking = (1.0 - self.release * (worst - 0.1).clamp(min=0.0)).clamp(0.0, 1.0)
        self.input[:, 2] = torch.where(self.time >= BRAKES_AT, braking, 0.0)


def randomise(sim: sw.Simulation, vehicle: Vehicle, load: Payload, rng: np.random.Generator) -> np.ndarray:
    """Another road, load and other tires in every world; returns the frictions."""
    worlds = sim.model.world_count
    assert isinstance(vehicle.tires, Tires)  # not rigid ones, which are shapes in contact
    bounds = np.array([ROADS[name] for name in road_names(worlds)])
    friction = rng.uniform(bounds[:, 0], bounds[:, 1])
    vehicle.tires.ground_friction.assign(friction.astype(np.float32))
    places = rng.uniform((-1.5, -0.3, 0.5), (0.0, 0.3, 1.0), (worlds, 3))
    set_payload(sim, load, mass=rng.uniform(50.0, 800.0, worlds), position=places)
    tires = vehicle.tires.parameter.numpy().copy()
    tires[:, :, CommonTire.STIFFNESS] *= rng.uniform(0.8, 1.2, (worlds, 1))
    for slope in (TmeasyTire.SLOPE_X, TmeasyTire.SLOPE_Y):
        tires[:, :, slope : slope + 2] *= rng.uniform(0.8, 1.2, (worlds, 1, 1))
    vehicle.tires.parameter.assign(tires)
    return friction


def road_names(worlds: int) -> list[str]:
    names = list(ROADS)
    return [names[world * len(names) // worlds] for world in range(worlds)]


def run(sim: sw.Simulation, vehicle: Vehicle, driver: LaneKeeper, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Until all stand: ways (samples, W, 2) [m] and stopping distances (W,) [m]."""
    chassis = vehicle.parts.chassis
    every = round(0.05 / sim.dt)
    ways, braked_at = [], None
    for step in range(round(longest / sim.dt)):
        if step % every == 0:
            ways.append(sim.state.body_x.numpy()[:, chassis, :2].copy())
            if braked_at is None and step * sim.dt >= BRAKES_AT:
                braked_at = len(ways) - 1
            if np.linalg.norm(sim.state.body_v.numpy()[:, chassis], axis=1).max() < 0.05:
                break
        driver.drive()
        sim.step()
    way = np.array(ways)
    return way, np.linalg.norm(np.diff(way[braked_at:], axis=0), axis=2).sum(axis=0)


def draw(path: str, way: np.ndarray, distance: np.ndarray, friction: np.ndarray, title: str, speed: float) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    roads = np.array(road_names(len(friction)))
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(12.0, 4.6), width_ratios=(1.5, 1.0), layout="constrained")
    for name, color in COLORS.items():
        chosen = roads == name
        left.plot(way[:, chosen, 0], way[:, chosen, 1], color=color, linewidth=0.5, alpha=0.35)
        left.plot(way[-1, chosen, 0], way[-1, chosen, 1], ".", color=color, markersize=3, label=name)
        right.plot(friction[chosen], distance[chosen], ".", color=color, markersize=4, alpha=0.6)
    grip = np.linspace(0.09, 0.92, 200)
    right.plot(grip, speed**2 / (2.0 * 9.81 * grip), "k--", linewidth=1.0, label="v² / (2 μ g)")
    left.set(xlabel="x [m]", ylabel="y, to the left [m]", title=title)
    left.legend(title="end on", markerscale=3.0)
    right.set(xlabel="friction of the road μ", ylabel="stopping distance [m]", yscale="log", title="stopping distance")
    right.set_ylim(0.8 * distance.min(), 1.25 * distance.max())
    low, high = right.get_ylim()
    ticks = [tick for tick in (0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500) if low <= tick <= high]
    right.set_yticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    right.minorticks_off()
    right.legend()
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=1000)
    parser.add_argument("--vehicle", default="hmmwv")
    parser.add_argument("--speed", type=float, default=15.0, help="m/s")
    parser.add_argument("--seconds", type=float, default=45.0, help="the longest that is waited for")
    parser.add_argument("--dt", type=float, default=0.002)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default=None)
    parser.add_argument("--plot", default=None, help="picture to write")
    args = parser.parse_args()
    if args.worlds < len(ROADS):
        raise SystemExit(f"--worlds: must be {len(ROADS)} or more, one for each road")

    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, load_vehicle(args.vehicle), speed=args.speed)
    load = add_payload(builder, parts, mass=400.0)
    model = builder.finalize(args.worlds, args.device, per_world=per_world(PAYLOAD))
    vehicle = Vehicle(parts, model, randomised=True)
    rng = np.random.default_rng(args.seed)
    gains = rng.uniform((0.02, 0.3, 2.0), (0.2, 1.5, 20.0), (args.worlds, 3))
    sim = sw.Simulation(model, args.dt, elements=[vehicle], solver=VEHICLE_SOLVER)
    driver = LaneKeeper(sim, vehicle, gains)
    friction = randomise(sim, vehicle, load, rng)

    began = time.perf_counter()
    way, distance = run(sim, vehicle, driver, args.seconds)
    wall = time.perf_counter() - began
    steps = (len(way) - 1) * round(0.05 / args.dt) * args.worlds
    roads = np.array(road_names(args.worlds))
    print(f"{'road':>6}{'worlds':>8}{'friction':>14}{'stopping distance [m]':>24}{'aside at the end [m]':>23}")
    for name, (low, high) in ROADS.items():
        chosen = roads == name
        stop, aside = distance[chosen], np.abs(way[-1, chosen, 1])
        ways = f"{np.median(stop):.1f} ({stop.min():.1f} to {stop.max():.1f})"
        sides = f"{np.median(aside):.2f} (up to {aside.max():.2f})"
        print(f"{name:>6}{chosen.sum():8d}{f'{low} to {high}':>14}{ways:>24}{sides:>23}")
    for line in sim.problems():
        print(line)
    print(f"{steps} world-steps in {wall:.1f} s: {steps / wall:.0f} per second")
    if args.plot:
        title = f"{args.worlds} times {args.vehicle} brakes from {args.speed:g} m/s"
        draw(args.plot, way, distance, friction, title, args.speed)
        print(f"wrote {args.plot}")


if __name__ == "__main__":
    main()
