"""A task, a robot, a camera and a lidar on the CPU and on the emulated device; prints as JSON how they agree.

`python -m tests.emulated_cuda tests/emulated_cuda/agreement.py [NAME ...]`
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np
import torch
import warp as wp

import simwarp as sw
from simwarp.kernels.core import scratch
from simwarp.sensors.cameras.camera import Camera, CameraConfig
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.ranging.beams import BeamTable
from simwarp.sensors.ranging.lidar import Lidar, LidarConfig
from simwarp.sensors.scene import Visuals
from tests.emulated_cuda.device import device
from tests.emulated_cuda.settings import StreamOrder

CUDA = "cuda:0"
SENSORS = ("camera", "lidar")
WORLDS, STEPS = 3, 4
Arrays = dict[str, np.ndarray]
LONGEST = scratch.LONGEST_STRIDE
VARIANTS = {
    "eager": (1, False, StreamOrder.EAGER, LONGEST),
    "captured": (7, True, StreamOrder.EAGER, LONGEST),
    "lazy": (3, True, StreamOrder.LAZY, LONGEST),
    "random": (5, True, StreamOrder.RANDOM, LONGEST),
    "slot by slot": (9, False, StreamOrder.EAGER, 0),
}
"""Seed of threads, whether control steps are captured, order of streams, and the longest stride of scratch [bytes]:
with 0 it lies slot by slot, as where worlds innermost would need longer strides than there are."""


def arrays_of(value: Any, path: str = "") -> Arrays:
    """All tensors in a result of a control step, by path."""
    if isinstance(value, torch.Tensor):
        return {path: value.detach().cpu().numpy().copy()}
    found: Arrays = {}
    fields = value if isinstance(value, dict) else vars(value) if hasattr(value, "__dict__") else {}
    for name, each in fields.items():
        found |= arrays_of(each, f"{path}.{name}")
    return found


def run_task(name: str, where: str, *, capture: bool) -> Arrays:
    """Results of control steps with the same actions."""
    task = sw.tasks.make(name, WORLDS, seed=4, device=where, capture=capture or where == "cpu")
    actions = torch.Generator().manual_seed(0)
    found: Arrays = {}
    for step in range(STEPS):
        action = 2.0 * torch.rand(WORLDS, task.action_size, generator=actions) - 1.0
        found |= arrays_of(task.step(action.to(task.device)), str(step))
    if capture and task.not_captured:
        raise RuntimeError(f"control steps of {name} are not captured: {task.not_captured}")
    return found


def run_sensor(name: str, where: str, *, capture: bool) -> Arrays:
    """Pictures or ranges of a body that turns among boxes, at another place in each world."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_body("car", mass=1.0, inertia=(1, 1, 1), velocity=(1.0, 0.5, 0.0), omega=(0.0, 0.0, 2.0))
    visuals = Visuals(builder)
    draws = np.random.default_rng(4)
    for index in range(8):
        place = np.array([4.0 * np.cos(index), 4.0 * np.sin(index), 0.0])
        color = draws.uniform(0.1, 1.0, 3)
        visuals.add_box(sw.WORLD, half=draws.uniform(0.2, 0.6, 3), pose=sw.pose(place), color=color)
    model = builder.finalize(WORLDS, where)
    scene, mount, schedule = visuals.finalize(model), Mount("car", sw.pose((0.3, 0.1, 0.2))), Schedule(rate=100.0)
    sensor: Any
    if name == "camera":
        sensor = Camera(scene, mount, CameraConfig(schedule=schedule, width=16, height=10, lens=Pinhole(fov=1.2)))
    else:
        beams = BeamTable(azimuth=np.linspace(1.5, -1.5, 30), elevation=(0.1, 0.0, -0.1))
        sensor = Lidar(scene, mount, LidarConfig(schedule=schedule, beams=beams, outputs="ranges"))
    sim = sw.Simulation(model, 0.01, sensors=[sensor])
    sim.state.body_x.assign(sim.state.body_x.numpy() + np.linspace(0.0, 0.5, WORLDS)[:, None, None])
    sim.step()
    if capture:
        with wp.ScopedCapture(where) as captured:
            sim.step()
        wp.capture_launch(captured.graph)
    else:
        sim.step()
    return {"data": sensor.data.numpy().copy(), "body": sim.state.body_x.numpy().copy()}


def run(name: str, where: str, *, capture: bool = False) -> Arrays:
    """Arrays of one case on one device."""
    if name in SENSORS:
        return run_sensor(name, where, capture=capture)
    return run_task(name, where, capture=capture)


def difference(a: Arrays, b: Arrays) -> dict[str, float]:
    """Largest difference of each array; infinite where one of two numbers is not finite."""
    found = {}
    for key, values in a.items():
        one, other = values.astype(float), b[key].astype(float)
        both = np.isfinite(one) & np.isfinite(other)
        same = bool((np.isfinite(one) == np.isfinite(other)).all())
        found[key] = float(np.abs(one - other)[both].max(initial=0.0)) if same else float("inf")
    return found


def equal(a: Arrays, b: Arrays) -> bool:
    """Whether all bits are the same."""
    return a.keys() == b.keys() and all(np.array_equal(a[key], b[key], equal_nan=a[key].dtype.kind == "f") for key in a)


def main(names: list[str]) -> None:
    """Run cases in all variants."""
    wp.config.log_level = wp.LOG_WARNING
    torch.set_num_threads(1)
    target = device()
    rows = {}
    for name in names:
        host = run(name, "cpu")
        variants = {}
        for variant, (seed, capture, streams, longest) in VARIANTS.items():
            target.seed, target.streams.order, scratch.LONGEST_STRIDE = seed, streams, longest
            variants[variant] = run(name, CUDA, capture=capture)
            target.streams.finish_all()
        eager = variants["eager"]
        rows[name] = {
            "arrays": len(host),
            "difference": max(difference(host, eager).values()),
            "equal": {variant: equal(eager, values) for variant, values in variants.items()},
            "faults": [text for text, _ in target.faults.violations],
            "races": target.races()[0],
            "captures": target.faults.counts["torch captures"] + target.faults.counts["captures"],
        }
    print(json.dumps(rows))


if __name__ == "__main__":
    main(sys.argv[1:])
