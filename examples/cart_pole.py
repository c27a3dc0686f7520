"""A thousand cart-poles, balanced by a linear feedback that torch computes in the simulator's own memory.

Run: python examples/cart_pole.py --worlds 1024 --seconds 5
"""

from __future__ import annotations

import argparse

import numpy as np
import torch

import simwarp as sw
from simwarp import to_torch

# Linear-quadratic regulator of this cart-pole: force per position, angle, speed and angular speed
GAINS = (-3.162, -36.56, -4.356, -11.13)


def cart_pole() -> sw.ModelBuilder:
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, -9.81))
    cart = builder.add_body("cart", mass=0.1, inertia=(1, 1, 1))
    pole = builder.add_body("pole", mass=0.785, inertia=(0.262, 0.262, 0.001), pose=sw.pose((0, 0, 1)))
    builder.add_joint_prismatic("slide", sw.WORLD, cart, axis=(1, 0, 0), limit=(-2, 2))
    builder.add_joint_revolute("hinge", cart, pole, anchor=(0, 0, 0), axis=(0, 1, 0))
    return builder


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=1024)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--device", default="cpu")
    args = parser.parse_args()

    model = cart_pole().finalize(world_count=args.worlds, device=args.device)
    sim = sw.Simulation(model, dt=0.01)

    # Every world starts with another angle and cart position; rates are zero
    start = np.random.default_rng(0).uniform((-0.5, -0.1), (0.5, 0.1), size=(args.worlds, 2))
    sim.set_joint_state(None, start, None)

    # Views made once: reading them reads the state, writing them writes the control
    q, qd = to_torch(sim.state.joint_q), to_torch(sim.state.joint_qd)
    force = to_torch(sim.control.joint_force)
    gains = torch.tensor(GAINS, device=q.device)
    slide = model.dof("slide")
    for _ in range(round(args.seconds / sim.dt)):
        force[:, slide] = torch.cat([q, qd], dim=1) @ -gains
        sim.step()

    print(f"{args.worlds} worlds after {args.seconds} s, cart-pole state of the first three:")
    print(f"{'position [m]':>14}{'angle [rad]':>14}")
    for position, angle in q[:3].tolist():
        print(f"{position:14.5f}{angle:14.5f}")
    print(f"upright: {int((q[:, 1].abs() < 0.2).sum())} of {args.worlds}")


if __name__ == "__main__":
    main()
