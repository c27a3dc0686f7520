"""Swing a pole up and balance it without a policy: 64 imagined carts try what to do next, 20 times a second.

Run: python examples/plan_cart_pole.py --film swing.gif

Samples of the push over the next 1.2 s are weighted by what they cost (MPPI); the first push of their mean is made, and
the rest of the plan is where the next one begins. The motor is too weak to lift the pole at once: it has to be swung.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import torch

import simwarp as sw
from simwarp.planning import Imagination, Mppi, MppiConfig
from simwarp.train import Frame, write_video
from simwarp.viewer import FollowCamera, Shot

DT, STEPS = 0.01, 5
"""Of a step [s], and steps between two plans."""
FORCE = 6.0
"""The most that the motor pushes [N]."""
RAIL = 1.5
"""Half the length of the rail [m]."""


def cart_pole() -> sw.ModelBuilder:
    """A cart of 1 kg on a rail along X, and a pole of 0.3 kg and 1 m that stands on it."""
    builder = sw.ModelBuilder()
    cart = builder.add_body("cart", mass=1.0, inertia=(0.1, 0.1, 0.1))
    pole = builder.add_body("pole", mass=0.3, inertia=(0.025, 0.025, 1e-4), pose=sw.pose((0.0, 0.0, 0.5)))
    here = (0.0, 0.0, 0.0)
    builder.add_joint_prismatic("rail", sw.WORLD, cart, axis=(1.0, 0.0, 0.0), anchor=here, limit=(-RAIL, RAIL))
    builder.add_joint_revolute("hinge", cart, pole, axis=(0.0, 1.0, 0.0), anchor=here, damping=0.002)
    return builder


def cost(sim: sw.Simulation, action: torch.Tensor) -> torch.Tensor:
    """Of one control step: the pole should stand still over the middle of the rail."""
    q, qd = sw.to_torch(sim.state.joint_q), sw.to_torch(sim.state.joint_qd)
    low = 1.0 - torch.cos(q[:, 1])
    still = 0.02 * qd[:, 1] ** 2 * torch.exp(-4.0 * low)
    return low + 0.3 * q[:, 0] ** 2 + 0.02 * qd[:, 0] ** 2 + still + 0.002 * action[:, 0] ** 2


class SwingUp:
    """Real carts whose poles hang down, and a plan for each of them.

    Args:
        worlds: real carts.
        samples: imagined ones of each.
        seed: of the starts and the samples.
    """

    def __init__(self, worlds: int = 1, samples: int = 64, seed: int = 0) -> None:
        self.real = sw.Simulation(cart_pole().finalize(worlds, "cpu"), DT)
        imagined = sw.Simulation(cart_pole().finalize(worlds * samples, "cpu"), DT)
        draws = np.random.default_rng(seed)
        start = np.stack([draws.uniform(-0.5, 0.5, worlds), math.pi + draws.uniform(-0.3, 0.3, worlds)], axis=1)
        self.real.set_joint_state(None, start, None)
        force, self._force = (sw.to_torch(sim.control.joint_force) for sim in (imagined, self.real))
        imagination = Imagination(
            self.real, imagined, act=lambda action: force[:, :1].copy_(FORCE * action), action_size=1, steps=STEPS
        )
        config = MppiConfig(horizon=24, knots=12, noise=0.7, temperature=0.3, iterations=2, seed=seed)
        self.planner = Mppi(imagination, cost, config)

    def step(self) -> None:
        """One control step of the real carts."""
        self._force[:, :1] = FORCE * self.planner.plan()
        self.real.step(STEPS)

    def upright(self) -> np.ndarray:
        """(worlds,) whether the pole stands, within 0.2 rad."""
        return np.cos(self.real.state.joint_q.numpy()[:, 1]) > math.cos(0.2)


def visible(builder: sw.ModelBuilder, model: sw.Model) -> sw.sensors.Scene:
    """What the film shows: bodies have no shapes of their own here."""
    visuals = sw.sensors.Visuals(builder)
    visuals.add_box(sw.WORLD, half=(RAIL + 0.2, 0.02, 0.01), pose=sw.pose((0.0, 0.0, -0.07)), color=(0.3, 0.3, 0.35))
    visuals.add_box(0, half=(0.15, 0.08, 0.06), color=(0.2, 0.45, 0.8))
    visuals.add_box(1, half=(0.02, 0.02, 0.5), color=(0.9, 0.5, 0.15))
    return visuals.finalize(model)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=1, help="real carts")
    parser.add_argument("--samples", type=int, default=64, help="imagined carts for each of them")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--film", type=Path, default=None, help=".gif or .mp4 to write")
    args = parser.parse_args()
    swing = SwingUp(args.worlds, args.samples, args.seed)
    camera = None
    if args.film:
        shot = Shot(body=sw.WORLD, target=(0.0, 0.0, 0.1), eye=(0.0, -5.0, 0.6))
        scene = visible(cart_pole(), swing.real.model)
        camera = FollowCamera(swing.real, scene, shot, width=480, height=270)
    frames, stood = [], np.zeros(args.worlds, int)
    for step in range(round(args.seconds / (DT * STEPS))):
        swing.step()
        stood = np.where(swing.upright(), stood + 1, 0)
        if camera is not None:
            time = step * DT * STEPS
            frames.append(Frame(time, camera.render(time)))
    print(f"{int((stood * DT * STEPS >= 1.0).sum())} of {args.worlds} poles stand since a second or more")
    if args.film:
        write_video(args.film, frames, "A pole swung up without a policy")
        print(f"{len(frames)} pictures: {args.film}")


if __name__ == "__main__":
    main()
