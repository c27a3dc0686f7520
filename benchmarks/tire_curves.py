"""Draws the forces of all tire models over slip: docs/images/tires.png.

    python benchmarks/tire_curves.py [--output docs/images/tires.png]

The tires are those of the HMMWV, at 20 m/s under 8 kN on a road of friction 0.8.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.vehicle.spec.vehicle_files import read_spec
from simwarp.vehicle.spec.vehicle_spec import Tire
from simwarp.vehicle.tires.parameter_vector import MODELS
from simwarp.vehicle.tires.parameter_vector_kernels import Common
from simwarp.vehicle.tires.tires import Mount, ParameterVector, Tires, tire_vector

ROOT = Path(__file__).resolve().parents[1]
TIRES = ROOT / "simwarp" / "vehicle" / "data" / "hmmwv" / "tires"
SPEED = 20.0
LOAD = 8000.0
FRICTION = 0.8

Array = npt.NDArray[np.float64]


def sweep(row: ParameterVector, height: float, velocity: Array, spin: Array) -> tuple[Array, Array, Array]:
    """Load (W,), force and torque (W, 3) of wheels that roll steadily at a height."""
    worlds = len(spin)
    tires = Tires([Mount(row, 0)], worlds, 1, "cpu", friction=FRICTION)
    state: Any = StateArrays()
    state.body_x = wp.array(np.tile([[[0.0, 0.0, height]]], (worlds, 1, 1)), dtype=wp.vec3d, device="cpu")
    state.body_rot = wp.array(np.tile([[[0.0, 0.0, 0.0, 1.0]]], (worlds, 1, 1)), dtype=wp.quatd, device="cpu")
    state.body_v = wp.array(velocity[:, None], dtype=wp.vec3, device="cpu")
    omega = np.stack([0 * spin, spin, 0 * spin], axis=-1)
    state.body_omega = wp.array(omega[:, None], dtype=wp.vec3, device="cpu")
    for _ in range(1000):
        tires.apply(1.0e-3, state)
    return (
        tires.load.numpy()[:, 0].astype(float),
        tires.force_w.numpy()[:, 0].astype(float),
        tires.torque_w.numpy()[:, 0].astype(float),
    )


def loaded_height(row: ParameterVector, radius: float) -> float:
    """Height of the centre at which the tire bears LOAD [m]."""
    low, high = 0.5 * radius, radius
    for _ in range(50):
        middle = 0.5 * (low + high)
        load = sweep_load(row, middle)
        low, high = (middle, high) if load > LOAD else (low, middle)
    return 0.5 * (low + high)


def sweep_load(row: ParameterVector, height: float) -> float:
    """Load of a wheel at rest [N]."""
    tires = Tires([Mount(row, 0)], 1, 1, "cpu")
    state: Any = StateArrays()
    state.body_x = wp.array([[[0.0, 0.0, height]]], dtype=wp.vec3d, device="cpu")
    state.body_rot = wp.array([[[0.0, 0.0, 0.0, 1.0]]], dtype=wp.quatd, device="cpu")
    state.body_v = wp.zeros((1, 1), dtype=wp.vec3, device="cpu")
    state.body_omega = wp.zeros((1, 1), dtype=wp.vec3, device="cpu")
    tires.apply(1.0e-3, state)
    return float(tires.load.numpy()[0, 0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "images" / "tires.png")
    output = parser.parse_args().output
    slips = np.linspace(-0.6, 0.6, 241)
    angles = np.deg2rad(np.linspace(-20.0, 20.0, 201))
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 8.0), constrained_layout=True)
    for name in MODELS:
        tire = read_spec(Tire, TIRES / f"{name}.json")
        row = tire_vector(tire)
        height = loaded_height(row, tire.radius)
        effective = tire.radius - row.values[Common.RADIUS_SHARE] * (tire.radius - height)
        forward = np.tile([SPEED, 0.0, 0.0], (len(slips), 1))
        _, force, _ = sweep(row, height, forward, SPEED * (1.0 + slips) / effective)
        axes[0, 0].plot(slips, force[:, 0] / 1e3, label=name)
        aside = np.stack([SPEED * np.cos(angles), SPEED * np.sin(angles), 0 * angles], axis=-1)
        _, force, torque = sweep(row, height, aside, SPEED * np.cos(angles) / effective)
        axes[0, 1].plot(np.rad2deg(angles), force[:, 1] / 1e3)
        axes[1, 0].plot(np.rad2deg(angles), torque[:, 2])
        # combined: from full braking over rolling to driving, at two slip angles
        for angle, style in ((np.deg2rad(2.0), "-"), (np.deg2rad(6.0), "--")):
            both = np.tile([SPEED * np.cos(angle), SPEED * np.sin(angle), 0.0], (len(slips), 1))
            _, force, _ = sweep(row, height, both, SPEED * np.cos(angle) * (1.0 + slips) / effective)
            axes[1, 1].plot(force[:, 0] / 1e3, force[:, 1] / 1e3, style, color=axes[0, 1].lines[-1].get_color())
    labels = (
        ("slip ratio", "F_x [kN]"), ("slip angle [°]", "F_y [kN]"), ("slip angle [°]", "M_z [N·m]"),
        ("F_x [kN]", "F_y [kN], slip angle 2° and (dashed) 6°"),
    )  # fmt: skip
    for panel, (x, y) in zip(axes.flat, labels, strict=True):
        panel.set(xlabel=x, ylabel=y)
        panel.grid(alpha=0.3)
    circle = np.linspace(0.0, -np.pi, 200)
    limit = 1e-3 * FRICTION * LOAD
    axes[1, 1].plot(limit * np.cos(circle), limit * np.sin(circle), color="gray", lw=0.8, label="0.8 F_z")
    axes[0, 0].legend()
    axes[1, 1].legend()
    figure.suptitle(f"HMMWV tires at {SPEED:g} m/s, {LOAD / 1e3:g} kN, road friction {FRICTION:g}")
    output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(output, dpi=110)
    print(output)


if __name__ == "__main__":
    main()
