"""Draws a blade that is pushed through soil: docs/images/soil_blade.png.

    python -m benchmarks.blade_push [--output docs/images/soil_blade.png]

Draft over way beside the fundamental equation of earth moving (`tests/reference/earth_moving.py`), without the heap and
with the mean weight of what lies on the wedge; and the ground after 2 m. Volumes and ratios are printed. It takes a
minute.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any, Final

import matplotlib.pyplot as plt
import numpy as np

from simwarp.soil import PRESETS, Soil
from tests.reference.earth_moving import Cut
from tests.unit.soil.blade_rig import pushed, volumes

ROOT = Path(__file__).resolve().parents[1]
CASES: Final = (("sand", 0.1, 90.0, "#b8860b"), ("clay", 0.1, 60.0, "#5b7d3a"), ("snow", 0.2, 60.0, "#0b6e99"))
"""Soil, depth [m], rake [degrees], colour."""
DELTA: Final = math.radians(20.0)
STEPS: Final = 4000
"""Of 1 ms at 0.5 m/s."""


def surcharge_of(element: Soil, cut: Cut, place: float, density: float) -> float:
    """Mean weight of the heap on the wedge ahead of an edge [Pa], from heights on a grid of its own."""
    found = 0.0
    for _ in range(20):
        ahead = place + 0.075 + np.linspace(0.0, cut.base(found), 41)  # nodes nearer than that are being cut
        x, y = np.meshgrid(ahead, np.linspace(-0.45, 0.45, 31))
        heights = element.height(np.stack([x.ravel(), y.ravel()], axis=1)).numpy()[0]
        found = 9.81 * density * float(np.maximum(heights, 0.0).mean())
    return found


def draw_draft(axes: Any) -> None:
    """Draft over way: simulated, the equation for a fresh cut, and with the heap."""
    for name, depth, rake, colour in CASES:
        soil, angle = PRESETS[name], math.radians(rake)
        simulation, element = pushed(depth, soil=soil, rake=angle)
        cut = Cut(soil.density, soil.cohesion, soil.friction_angle, depth, angle, DELTA)
        way, force, heaped = [], [], []
        for step in range(STEPS // 50):
            simulation.step(2 if step == 0 else 50)
            way.append(float(simulation.state.body_x.numpy()[0, 0, 0]))
            force.append(-float(element.force_w.numpy()[0, 0, 0]))
            heaped.append(cut.draft(1.0, surcharge_of(element, cut, way[-1], soil.density)))
        label = f"{name}, {100.0 * depth:g} cm, {rake:g}°"
        axes.plot(way, 1e-3 * np.array(force), color=colour, lw=1.6, label=label)
        axes.plot(way, 1e-3 * np.array(heaped), "--", color=colour, lw=1.0)
        axes.plot(0.0, 1e-3 * cut.draft(1.0), "o", color=colour, ms=5)
        ratios = np.array(force[4:]) / np.array(heaped[4:])
        trench, heap, waits = volumes(element)
        print(
            f"{label}: fresh {force[0]:.0f} N, equation {cut.draft(1.0):.0f}; with the heap {ratios.min():.2f} to "
            f"{ratios.max():.2f} of it; cut {trench:.4f}, heap {heap:.4f} m3, apart {heap + waits - trench:.1e}"
        )
    axes.set(xlabel="way [m]", ylabel="draft per metre of width [kN]", ylim=(0.0, None), xlim=(-0.03, None))
    axes.set_title("dots: the equation for a fresh cut, dashed: with the heap on the wedge", fontsize=9)
    axes.legend(frameon=False, fontsize=8)


def draw_ground(axes: Any) -> Any:
    """Heights after 2 m, seen from above."""
    simulation, element = pushed(0.1, spacing=0.05)
    simulation.step(STEPS)
    x, y = np.meshgrid(np.arange(-0.3, 3.3, 0.02), np.arange(-1.4, 1.4, 0.02))
    heights = element.height(np.stack([x.ravel(), y.ravel()], axis=1)).numpy()[0].reshape(x.shape)
    picture = axes.imshow(
        100.0 * heights, extent=(-0.3, 3.3, -1.4, 1.4), origin="lower", cmap="BrBG_r", vmin=-45.0, vmax=45.0
    )
    axes.set(xlabel="way [m]", ylabel="aside [m]")
    axes.set_title("height of dry sand after a cut of 10 cm, 1 m wide", fontsize=9)
    return picture


def main() -> None:
    """Draws and saves the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "docs/images/soil_blade.png")
    output = parser.parse_args().output
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 3.9), width_ratios=(1.0, 1.15))
    draw_draft(left)
    figure.colorbar(draw_ground(right), ax=right, label="cm", shrink=0.8)
    figure.tight_layout()
    figure.savefig(output, dpi=110)
    print(f"wrote {output}")


if __name__ == "__main__":
    main()
