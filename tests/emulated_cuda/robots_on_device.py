"""Imported robots on the CPU and on the emulated device; prints as JSON how they agree.

`python -m tests.emulated_cuda tests/emulated_cuda/robots_on_device.py FILE ...`
"""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path

import numpy as np
import warp as wp

import simwarp as sw
from tests.emulated_cuda.device import device
from tests.emulated_cuda.settings import StreamOrder

WORLDS, STEPS = 3, 10


def builder_of(file: Path) -> sw.ModelBuilder:
    """A robot as its file has it, a URDF's root welded to the world."""
    if file.suffix == ".urdf":
        return sw.importers.load_urdf(file, base="fixed").builder
    return sw.importers.load_mjcf(file).builder


def places(file: Path, where: str, *, capture: bool = False) -> np.ndarray:
    """(W, B, 3) after some steps, the worlds at different speeds."""
    model = builder_of(file).finalize(WORLDS, where)
    sim = sw.Simulation(model, 0.002, check_start=False)
    sim.set_joint_state(None, None, np.linspace(0.0, 0.3, WORLDS * model.dof_count).reshape(WORLDS, -1))
    sim.step()
    if capture:
        with wp.ScopedCapture(where) as captured:
            sim.step()
        for _ in range(STEPS - 1):
            wp.capture_launch(captured.graph)
    else:
        sim.step(STEPS - 1)
    return np.asarray(sim.state.body_x.numpy())


def main(files: list[str]) -> None:
    """Run each robot."""
    warnings.simplefilter("ignore")
    wp.config.log_level = wp.LOG_WARNING
    target, rows = device(), {}
    for name in files:
        host = places(Path(name), "cpu")
        found = {}
        for seed, order, capture in ((1, StreamOrder.EAGER, False), (7, StreamOrder.LAZY, True)):
            target.seed, target.streams.order = seed, order
            found[seed] = places(Path(name), "cuda:0", capture=capture)
        rows[name] = {
            "difference": float(np.abs(host - found[1]).max()), "equal": bool(np.array_equal(found[1], found[7])),
            "moved": float(np.ptp(host, axis=0).max()), "faults": [text for text, _ in target.faults.violations],
            "races": target.races()[0],
        }  # fmt: skip
    print(json.dumps(rows))


if __name__ == "__main__":
    main(sys.argv[1:])
