"""Draws toe, camber and steering of all shipped vehicles: docs/images/suspension_kinematics.png.

    python benchmarks/suspension_curves.py [--output docs/images/suspension_kinematics.png]

Both wheels of an axle travel together; the ARTcar, a model car, by a quarter of what the others do.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

from simwarp.vehicle.spec.vehicle_files import load_vehicle, vehicle_names
from simwarp.vehicle.spec.vehicle_spec import RigidSuspension, VehicleSpec
from simwarp.vehicle.suspensions.kinematics import TravelTable, travel_table

ROOT = Path(__file__).resolve().parents[1]
TRAVEL = 0.08

Array = npt.NDArray[np.float64]


def travels(name: str) -> Array:
    """Travels of a vehicle's wheels [m]."""
    return np.linspace(-TRAVEL, TRAVEL, 81) * (0.25 if name == "artcar" else 1.0)


def draw_travel(panels: tuple[Any, Any], spec: VehicleSpec, axle: int, label: str, color: str) -> None:
    """Toe and camber of an axle's left wheel over travel."""
    if isinstance(spec.axles[axle].suspension, RigidSuspension):
        return
    heights = travels(spec.name)
    table = travel_table(spec, axle, heights)
    for panel, angles in zip(panels, (table.toe, table.camber), strict=True):
        # the reduced one's front is the HMMWV's: a line within its line
        width = 4.0 if label == "hmmwv" else 1.5
        panel.plot(np.rad2deg(angles[:, 0]), 1e3 * heights, color=color, label=label, linewidth=width)


def draw_steering(panels: tuple[Any, Any], spec: VehicleSpec, label: str, color: str) -> None:
    """Angles of both front wheels over the steering, and by how much they differ."""
    inputs = np.linspace(-1.0, 1.0, 81)
    table = travel_table(spec, 0, 0.0, inputs)
    left, right = np.rad2deg(table.steer).T
    panels[0].plot(inputs, left, color=color, label=label)
    panels[0].plot(inputs, right, "--", color=color)
    mean = 0.5 * (left + right)
    panels[1].plot(mean, left - right, color=color, label=label)
    panels[1].plot(mean, np.rad2deg(ackermann(spec, table, np.deg2rad(mean))), ":", color=color)


def ackermann(spec: VehicleSpec, table: TravelTable, mean: Array) -> Array:
    """Ackermann's difference of the two angles, for which all wheels roll about one point of the rear axle's line."""
    track = float(np.ptp(table.center[len(mean) // 2, :, 1]))
    ends = [axle.location[0] + axle.suspension.spindle.com[0] for axle in (spec.axles[0], spec.axles[-1])]
    wheelbase, turn = ends[0] - ends[1], np.where(mean == 0.0, 1e-9, mean)
    radius = np.abs(wheelbase / np.tan(turn))
    inner, outer = (np.arctan2(wheelbase, radius - way * track / 2.0) for way in (1.0, -1.0))
    return np.asarray(inner - outer)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    default = ROOT / "docs" / "images" / "suspension_kinematics.png"
    parser.add_argument("--output", type=Path, default=default)
    output = parser.parse_args().output
    figure, axes = plt.subplots(2, 3, figsize=(14.0, 9.0), constrained_layout=True)
    for index, name in enumerate(vehicle_names()):
        spec, color = load_vehicle(name), f"C{index}"
        draw_travel((axes[0, 0], axes[0, 1]), spec, 0, name, color)
        draw_travel((axes[1, 0], axes[1, 1]), spec, len(spec.axles) - 1, name, color)
        draw_steering((axes[0, 2], axes[1, 2]), spec, name, color)
    for row, where in enumerate(("front", "rear")):
        # the Gator's steers far: its first five degrees leave room for the others
        axes[row, 0].set(xlabel=f"toe, {where} [°], + front inwards", ylabel="travel [mm]", xlim=(-5.0, 5.0))
        axes[row, 1].set(xlabel=f"camber, {where} [°], + top outwards", ylabel="travel [mm]")
    axes[0, 2].set(xlabel="steering, + to the left", ylabel="front wheels [°]: left, right (dashed)")
    axes[1, 2].set(xlabel="mean angle of the front wheels [°]", ylabel="left less right [°]; Ackermann's (dotted)")
    far = travel_table(load_vehicle("gator"), 0, travels("gator")).toe
    low, high = np.rad2deg([far.min(), far.max()])
    note = f"gator goes on: {low:.0f}° to {high:.0f}°"
    axes[0, 0].text(0.03, 0.03, note, transform=axes[0, 0].transAxes, color=f"C{vehicle_names().index('gator')}")
    for panel in axes.flat:
        panel.grid(alpha=0.3)
    axes[0, 1].legend()
    figure.suptitle("Kinematics of the shipped vehicles' suspensions: both wheels together, left wheel shown")
    output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(output, dpi=110)
    print(output)


if __name__ == "__main__":
    main()
