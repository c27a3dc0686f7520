"""Errors and cost of the step over `numerical_damping`: the tables of docs/integrators.md.

Run: python benchmarks/integrators.py        some ten seconds; the models are those of tests/physics/test_integrators.py
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from simwarp import scenes  # noqa: E402
from tests.physics import test_integrators as integrators  # noqa: E402

DAMPING = (1.0, 0.1, 0.0)


def errors() -> None:
    print("error at the end for steps that halve, and the order between the last two")
    models: list[tuple[str, integrators.Linear | integrators.Motion]] = [
        *integrators.LINEAR.items(), *integrators.MOTIONS.items(),
    ]  # fmt: skip
    for name, model in models:
        for damping in DAMPING:
            found = model.errors(damping)
            row = "  ".join(f"{1e3 * h:g} ms {error:.1e}" for h, error in zip(model.steps, found, strict=True))
            print(f"  {name}, {damping:g}: {row}  order {integrators.orders(found)[-1]:.2f}")


def decay() -> None:
    law = 0.5e-3 * integrators.OMEGA**2
    print(f"decay of 10 Hz at 1 ms: undamped, by its law {law:.3f}/s times the damping; damped, over the exact one")
    for damping in DAMPING:
        free, damped = integrators.sprung_decay(damping, rate=0.0), integrators.sprung_decay(damping, steps=300)
        print(f"  {damping:g}: {free:.4f}/s; {damped / integrators.RATE:.4f}")


def resonance() -> None:
    exact = integrators.wheel_hop_exact().max()
    print(f"second resonance of the quarter car, exact {exact:.3f}")
    for h in (5e-4, 1e-3, 2e-3):
        shares = [f"{damping:g} {integrators.wheel_hop(damping, h).max() / exact:.4f}" for damping in DAMPING]
        print(f"  {1e3 * h:g} ms: {', '.join(shares)}")


def cost(rounds: int = 15, steps: int = 300) -> None:
    print("CPU time of a step over that of 1, least of turns that alternate")
    for name in ("linkage", "ant"):
        builder = getattr(scenes, name)()
        sims = [integrators.simulation(builder, 1e-3, damping, worlds=8) for damping in DAMPING]
        spent = np.zeros((rounds, len(sims)))
        for turn in spent:
            for k, sim in enumerate(sims):
                sim.reset()
                start = time.process_time()
                sim.step(steps)
                turn[k] = time.process_time() - start
        shares = spent.min(axis=0) / spent[:, 0].min()
        print(f"  {name}: " + ", ".join(f"{d:g} {share:.3f}" for d, share in zip(DAMPING, shares, strict=True)))


if __name__ == "__main__":
    for part in (errors, decay, resonance, cost):
        part()
