"""A sedan drifts around a circle of ice without a policy: 48 imagined ones try wheel and pedals, ten times a second.

Run: python examples/plan_drift.py --film drift.gif

The cost asks for a circle, for a car that points 40 degrees into it, and for speed. That the tail has to be kicked out,
and the front wheels turned against the bend, is found by trying.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import torch

import simwarp as sw
from simwarp.planning import Imagination, Mppi, MppiConfig
from simwarp.train import Frame, write_video
from simwarp.vehicle import VEHICLE_SOLVER, Vehicle, add_vehicle, load_vehicle, per_world
from simwarp.viewer import FollowCamera, Polyline, Shot

DT, STEPS = 0.005, 20
"""Of a step [s], and steps between two plans."""
ICE = 0.3
"""Friction of the ground."""
RADIUS = 14.0
"""Of the circle about the origin [m]."""
SLIP = -math.radians(40.0)
"""Angle from the car's heading to its way, negative where the nose points into a left-hand bend [rad]."""


class Car:
    """Sedans on ice, in some worlds, and what a cost reads of them."""

    def __init__(self, worlds: int) -> None:
        self.builder = sw.ModelBuilder()
        spec = load_vehicle("sedan")
        parts = add_vehicle(self.builder, spec, at=sw.pose((0.0, -RADIUS, spec.start_height)), speed=6.0)
        model = self.builder.finalize(worlds, "cpu", per_world=per_world())
        self.vehicle = Vehicle(parts, model)
        self.vehicle.tires.ground_friction.fill_(ICE)
        self.sim = sw.Simulation(model, DT, elements=[self.vehicle], solver=VEHICLE_SOLVER)
        self.input = sw.to_torch(self.vehicle.input)
        self.position, self.velocity = sw.to_torch(self.vehicle.position), sw.to_torch(self.vehicle.velocity_b)

    def act(self, action: torch.Tensor) -> None:
        """Steering, and one number for both pedals, as the vehicle's inputs."""
        self.input[:, 0] = action[:, 0]
        self.input[:, 1] = action[:, 1].clamp(min=0.0)
        self.input[:, 2] = (-action[:, 1]).clamp(min=0.0)

    def slip(self) -> torch.Tensor:
        """(W,) angle from the heading to the way [rad]."""
        return torch.atan2(self.velocity[:, 1], self.velocity[:, 0].abs().clamp(min=0.5))

    def cost(self, sim: sw.Simulation, action: torch.Tensor) -> torch.Tensor:
        """Of one control step."""
        aside = torch.linalg.norm(self.position[:, :2], dim=1) - RADIUS
        speed = torch.linalg.norm(self.velocity[:, :2], dim=1)
        return 0.15 * aside**2 + 4.0 * (self.slip() - SLIP) ** 2 - 0.2 * speed + 0.02 * (action**2).sum(dim=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=48, help="imagined cars")
    parser.add_argument("--seconds", type=float, default=14.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--film", type=Path, default=None, help=".gif or .mp4 to write")
    args = parser.parse_args()
    real, imagined = Car(1), Car(args.samples)
    imagination = Imagination(real.sim, imagined.sim, act=imagined.act, action_size=2, steps=STEPS)
    config = MppiConfig(horizon=15, knots=5, noise=(0.5, 0.4), temperature=1.0, seed=args.seed)
    planner = Mppi(imagination, imagined.cost, config)
    camera = None
    if args.film:
        visuals = sw.sensors.Visuals(real.builder)
        visuals.add_plane(name="ice", color=(0.8, 0.87, 0.93))
        sw.viewer.add_bodies(visuals)
        sw.viewer.paint(visuals)
        shot = Shot(body=real.vehicle.parts.chassis, target=(0.0, 0.0, 0.0), eye=(-8.0, -16.0, 13.0))
        scene = visuals.finalize(real.sim.model)
        camera = FollowCamera(real.sim, scene, shot, width=480, height=300, marks=True)
    frames, way, drifting = [], [], 0
    for step in range(round(args.seconds / (DT * STEPS))):
        real.act(planner.plan())
        real.sim.step(STEPS)
        way.append(real.position[0].clone())
        angle = math.degrees(real.slip().item())
        drifting = drifting + 1 if angle < -20.0 else 0
        if step % 10 == 9:
            aside, speed = torch.linalg.norm(way[-1][:2]) - RADIUS, torch.linalg.norm(real.velocity[0])
            print(f"{(step + 1) * DT * STEPS:4.1f} s: {angle:5.0f} degrees, {aside:5.1f} m aside, {speed:4.1f} m/s")
        if camera is not None:
            line = Polyline(torch.stack(way).numpy(), (0.1, 0.35, 0.8), 2.0)
            frames.append(Frame(step * DT * STEPS, camera.render(step * DT * STEPS, [[line]])))
    print(f"drifts since {drifting * DT * STEPS:.1f} s")
    if args.film:
        write_video(args.film, frames, "A drift on ice without a policy")
        print(f"{len(frames)} pictures: {args.film}")


if __name__ == "__main__":
    main()
