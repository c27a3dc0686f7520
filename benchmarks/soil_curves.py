"""Draws what soils do to plates, wheels and a vehicle: docs/images/soil.png.

    python benchmarks/soil_curves.py [--output docs/images/soil.png]

All curves are measured in the simulation with the rigs of `simwarp verify soil`; dashed lines in the first two panels
are the law. It takes a minute.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from pathlib import Path
from typing import Any, Final

import matplotlib.pyplot as plt
import numpy as np

from simwarp.soil import PRESETS, ShearMemory, soil_under
from simwarp.vehicle import load_vehicle, with_options
from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.results.results import pull_at
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.verify.soil_rigs import (
    LOAD,
    PLATE_AREA,
    PLATE_RADIUS,
    DrivenWheel,
    dragged_plate,
    driven_wheels,
    pressed_plate,
    repeated_passes,
)

ROOT = Path(__file__).resolve().parents[1]
COLOURS: Final = {"soft": "#8a5a00", "mid": "#0b6e99", "hard": "#b8470f", "clay": "#5b7d3a"}
QUIET: Final = {name: dataclasses.replace(spec, damping=0.0) for name, spec in PRESETS.items()}
WAY: Final = 0.012
"""To which the plate is dragged, and back from which [m]."""


def draw_pressure(axes: Any) -> None:
    """A plate pressed to 2 and 4 cm, let go of each time."""
    for name in ("hard", "clay", "mid", "soft"):
        spec = QUIET[name]
        sinkage, pressure = pressed_plate(spec, (0.02, 0.04, 0.05), "cpu")
        law = np.linspace(0.0, 0.05, 200)
        curve = (spec.k_c / PLATE_RADIUS + spec.k_phi) * law**spec.exponent
        axes.plot(1e2 * sinkage, 1e-3 * pressure, color=COLOURS[name], lw=1.4, label=name)
        axes.plot(1e2 * law, 1e-3 * curve, "--", color="black", lw=0.7)
    axes.set(xlabel="sinkage [cm]", ylabel="pressure [kPa]", ylim=(0.0, None), xlim=(0.0, 5.1))
    axes.set_title("a plate pressed, let go of at 2 and 4 cm, pressed again")
    axes.legend(frameon=False)


def draw_shear(axes: Any) -> None:
    """A plate dragged by 12 mm, and back."""
    for name in ("hard", "mid"):
        for memory, style in ((ShearMemory.DIRECTION, "-"), (ShearMemory.SCALAR, ":")):
            drag = dragged_plate(QUIET[name], 0.0, "cpu", memory, ways=(WAY, 0.0))
            back = np.arange(len(drag.way)) > int(np.argmax(drag.way))
            force = np.where(back, -drag.force, drag.force) / drag.load
            label = f"{name}, {'default' if memory is ShearMemory.DIRECTION else 'scalar memory'}"
            axes.plot(1e3 * drag.way, force, style, color=COLOURS[name], lw=1.4, label=label)
        spec, way = PRESETS[name], np.linspace(0.0, WAY, 100)
        full = math.tan(spec.friction_angle) + PLATE_AREA * spec.cohesion / 6000.0
        axes.plot(1e3 * way, -full * np.expm1(-way / spec.shear_length), "--", color="black", lw=0.7)
    axes.axhline(0.0, color="black", lw=0.5)
    axes.annotate("there", (6.0, 0.36), fontsize=9)
    axes.annotate("and back", (5.0, -0.44), fontsize=9)
    axes.set(xlabel="displacement [mm]", ylabel="shear force / load")
    axes.set_title("a plate of 6 kN dragged by 12 mm and back")
    axes.legend(frameon=False, fontsize=8, ncols=2, loc="center", bbox_to_anchor=(0.42, 0.42))


def draw_pull(axes: Any) -> None:
    """Driven wheels, and a vehicle in a drawbar test."""
    slips = np.array([0.02, 0.05, 0.08, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6])
    names = ("hard", "mid", "soft")
    wheels = [DrivenWheel(slip=float(slip), soil=QUIET[name]) for name in names for slip in slips]
    for memory, style in ((ShearMemory.DIRECTION, "-"), (ShearMemory.SCALAR, ":")):
        pull = driven_wheels(wheels, 0.05, "cpu", memory).pull.reshape(len(names), -1)
        for name, each in zip(names, pull, strict=True):
            label = f"{name}, one wheel" if memory is ShearMemory.DIRECTION else None
            axes.plot(slips, each, style, color=COLOURS[name], lw=1.4, label=label)
    spec = with_options(load_vehicle("hmmwv"), tire="soil-rigid")
    for name in names:

        def below(vehicle: Any, soil: str = name) -> list[Any]:
            return [soil_under(vehicle, soil)]

        setup = set_up(spec, maneuver("drawbar", spec, duration=30.0), device="cpu", dt=2e-3, elements=below)
        run = Drive(setup).run()
        run = dataclasses.replace(run, columns={key: value[run["t_s"] > 5.0] for key, value in run.columns.items()})
        told = [pull_at(run, float(slip)) for slip in slips]
        label = "HMMWV, drawbar test" if name == names[0] else None
        axes.plot(slips, told, "o", color=COLOURS[name], ms=4, mfc="none", label=label)
    axes.axhline(math.tan(math.radians(30.0)), color="black", lw=0.7, ls="--")
    axes.annotate("tan 30°", (0.0, 0.585), fontsize=8)
    axes.axhline(0.0, color="black", lw=0.5)
    axes.set(xlabel="slip", ylabel="pull / load", ylim=(-0.45, 0.7))
    axes.set_title(f"pull over slip, wheels of {LOAD / 1e3:g} kN (dotted: scalar memory)")
    axes.legend(frameon=False, fontsize=8, loc="lower right")


def draw_ruts(axes: Any) -> None:
    """Depth across the way of a wheel after several passes."""
    for name in ("mid", "hard"):
        profiles = repeated_passes(PRESETS[name], 5, 0.02, "cpu")
        for count, style in ((1, "-"), (2, "--"), (5, ":")):
            across, depth = profiles[count - 1]
            y = np.concatenate([[-0.3, across[0] - 0.02], across, [across[-1] + 0.02, 0.3]])
            z = np.concatenate([[0.0, 0.0], -depth, [0.0, 0.0]])
            label = f"{name}, {count} pass{'es' if count > 1 else ''}"
            axes.plot(1e2 * y, 1e2 * z, style, color=COLOURS[name], lw=1.4, marker=".", ms=3, label=label)
    axes.set(xlabel="across the way [cm]", ylabel="depth [cm]", xlim=(-30.0, 30.0), ylim=(-17.0, 0.7))
    axes.set_title(f"ruts of a wheel of {LOAD / 1e3:g} kN, 0.254 m wide, nodes every 2 cm")
    axes.legend(frameon=False, fontsize=8, ncols=2, loc="lower center")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "images" / "soil.png")
    output = parser.parse_args().output
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 8.0), constrained_layout=True)
    for panel, draw in zip(axes.flat, (draw_pressure, draw_shear, draw_pull, draw_ruts), strict=True):
        draw(panel)
        panel.grid(alpha=0.3)
        panel.title.set_fontsize(10)
    output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(output, dpi=110)
    print(output)


if __name__ == "__main__":
    main()
