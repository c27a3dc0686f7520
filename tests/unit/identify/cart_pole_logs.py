"""A cart-pole with known numbers, and logs of it: what tests fit."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import simwarp as sw
from simwarp.identify import fit_config
from simwarp.identify.fit_config import FitConfig, of_target
from simwarp.identify.model_target import ModelTarget
from simwarp.identify.world_numbers import World

Array = npt.NDArray[np.float64]

DT = 0.005
SAMPLE = 0.02
SECONDS = 1.0
READINGS = ("joint_position:slide", "joint_position:hinge")
PARAMETERS: dict[str, Any] = {
    "bodies[pole].mass": {"start": 1.1},
    "joints[slide].dofs[0].damping": {"start": 0.8},
    "bodies[pole].com_shift[2]": {"start": 0.06, "low": -0.3, "high": 0.3},
}
TRUTH = (0.8, 0.5, 0.0)


def cart_pole() -> sw.ModelBuilder:
    """A pole of 0.8 kg on a cart of 1 kg."""
    builder = sw.ModelBuilder()
    cart = builder.add_body("cart", mass=1.0, inertia=(1.0, 1.0, 1.0))
    pole = builder.add_body("pole", mass=0.8, inertia=(0.3, 0.3, 0.01), pose=sw.pose((0.0, 0.0, 0.5)))
    builder.add_joint_prismatic("slide", sw.WORLD, cart, axis=(1, 0, 0), damping=0.5)
    builder.add_joint_revolute("hinge", cart, pole, anchor=(0, 0, 0), axis=(0, 1, 0), damping=0.05)
    return builder


def force(times: npt.NDArray[np.floating]) -> Array:
    """What pushes the cart [N]."""
    return np.asarray(6.0 * np.sin(9.0 * times) + 3.0 * np.cos(4.0 * times))


def write_logs(folder: Path, *, angle: float = 0.4, noise: float = 0.0, seed: int = 0, name: str = "run") -> None:
    """The model's file, and a run of it: readings and pushes at rates of their own."""
    sw.save_model(cart_pole(), folder / "cartpole.json")
    samples = round(SECONDS / SAMPLE)
    steps = DT * np.arange(samples * round(SAMPLE / DT))
    record = simulated(cart_pole(), force(steps), {"joint_position:hinge": angle}, samples)
    record = record + noise * np.random.default_rng(seed).standard_normal(record.shape)
    times = SAMPLE * np.arange(samples + 1)
    np.savez(folder / f"{name}.npz", t_s=times, slide=record[:, 0], hinge=record[:, 1])
    pushes = np.append(steps, [SECONDS])
    np.savez(folder / f"{name}_force.npz", t_s=pushes, force=force(pushes))


def simulated(builder: sw.ModelBuilder, push: Array, start: dict[str, float], samples: int) -> Array:
    """(samples + 1, 2) readings of one world, pushed by (steps,) forces [N]."""
    config = dataclasses.replace(of_target("cartpole.json"), dt=DT, sample=SAMPLE)
    target = ModelTarget(config, "cpu", 1, builder)
    rollout = target.rollout(1, set(), READINGS, ("joint_force:slide",))
    world = World(target.numbers(target.document, {}), push[:, None], start)
    return rollout.run([world], samples)[:, 0]


def config_of(folder: Path, **changes: Any) -> FitConfig:
    """A fit of the cart-pole to its run."""
    values = {
        "target": "cartpole.json", "dt": DT, "sample": SAMPLE,
        "runs": [{
            "file": ["run.npz", "run_force.npz"], "start": {"joint_velocity:slide": 0.0, "joint_velocity:hinge": 0.0}
        }],
        "readings": {"joint_position:slide": "slide", "joint_position:hinge": "hinge"},
        "inputs": {"joint_force:slide": "force"}, "parameters": PARAMETERS,
    }  # fmt: skip
    return fit_config({**values, **changes}, folder=str(folder))
