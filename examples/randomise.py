"""Worlds that share a topology and differ in their numbers: each has its own mass and spring, and its own rhythm.

The measured frequency of every world stands beside sqrt(k / m) / (2 pi).

Run: python examples/randomise.py --worlds 16 --seconds 5
"""

from __future__ import annotations

import argparse

import numpy as np

import simwarp as sw


def oscillator() -> sw.ModelBuilder:
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    mass = builder.add_body("mass", mass=1.0, inertia=(0.01, 0.01, 0.01))
    builder.add_joint_prismatic("slide", sw.WORLD, mass, axis=(1, 0, 0), stiffness=100.0)
    return builder


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=16)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()

    # Parameters named here get one copy per world; all others stay shared
    model = oscillator().finalize(args.worlds, device="cpu", per_world=("body_mass", "joint_stiffness"))
    rng = np.random.default_rng(args.seed)
    masses = rng.uniform(0.5, 2.0, size=(args.worlds, 1)).astype(np.float32)
    springs = rng.uniform(50.0, 200.0, size=(args.worlds, 1)).astype(np.float32)
    model.body_mass.assign(masses)
    model.joint_stiffness.assign(springs)

    sim = sw.Simulation(model, dt=0.001)
    sim.set_joint_state(None, np.full((args.worlds, 1), 0.1), None)
    positions = []
    for _ in range(round(args.seconds / sim.dt)):
        sim.step()
        positions.append(sim.state.joint_q.numpy()[:, 0].copy())
    expected = np.sqrt(springs / masses)[:, 0] / (2.0 * np.pi)

    print(f"{'world':>6}{'mass [kg]':>12}{'k [N/m]':>10}{'expected [Hz]':>15}{'measured [Hz]':>15}")
    worst = 0.0
    for world in range(args.worlds):
        x = np.array([column[world] for column in positions])
        k = np.flatnonzero((x[:-1] > 0.0) & (x[1:] <= 0.0))
        if len(k) < 2:
            raise SystemExit("too short to see two periods: raise --seconds")
        crossings = sim.dt * (k + x[k] / (x[k] - x[k + 1]))
        measured = (len(k) - 1) / (crossings[-1] - crossings[0])
        worst = max(worst, abs(measured / expected[world] - 1.0))
        if world < 8:
            row = f"{masses[world, 0]:12.3f}{springs[world, 0]:10.1f}{expected[world]:15.4f}{measured:15.4f}"
            print(f"{world:6d}{row}")
    print(f"largest relative difference over {args.worlds} worlds: {worst:.1e}")

    # One world starts over; the others do not notice
    sim.reset(np.arange(args.worlds) == 0)
    print(f"time of each world after the reset [s]: {np.round(sim.time.numpy()[:4], 3).tolist()} ...")


if __name__ == "__main__":
    main()
