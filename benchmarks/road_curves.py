"""Draws random roads of ISO 8608 and a vehicle on them: docs/images/roads.png.

    python benchmarks/road_curves.py [--output docs/images/roads.png] [--json FILE]

Spectra of roads of the classes A to F along eight lines of 1024 m (Welch's estimate) against the bands of the classes,
the HMMWV on a road of class E, and the vertical acceleration of its chassis at the centre of mass on roads of all
classes, weighted by W_k of ISO 2631-1 too.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any, Final

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.ticker import LogLocator
from PIL import Image
from scipy import signal

from simwarp.cli.view.drive_film import DriveFilm
from simwarp.vehicle import Drive, load_vehicle, set_up
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.driving.path_tracking import PathTrackingSpec
from simwarp.vehicle.driving.paths import Path as PathOfRoad
from simwarp.vehicle.results.plot_style import BLUE, GREY, INK, ORANGE, dress, title_of
from simwarp.vehicle.roads import random_road
from simwarp.vehicle.roads.random_roads import NODES, SPACING
from simwarp.vehicle.roads.road_profiles import RoadClass, displacement_spectrum

Array = npt.NDArray[np.float64]

ROOT: Final = Path(__file__).resolve().parents[1]
CLASSES: Final = "ABCDEF"
LINES: Final = 8
APART: Final = 12.8
"""Between the lines of a spectrum [m]."""
SEGMENT: Final = 4096
"""Samples of a segment of Welch's method: 204.8 m."""
RUNS: Final = (("hmmwv", 10.0), ("hmmwv", 15.0), ("hmmwv-reduced", 15.0))
"""Vehicle and speed [m/s]."""
DT: Final = 1.0e-3
SETTLED: Final = 3.0
"""Time of a run that does not count [s]."""
DURATION: Final = 18.0
SEED: Final = 3
BOUNDS: Final = ((0.315, "a little uncomfortable"), (0.8, "uncomfortable"), (2.0, "extremely uncomfortable"))
"""Of ISO 2631-1, annex C, on the weighted acceleration [m/s²]."""


def weighting(frequency: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    """W_k of ISO 2631-1, of vertical vibration of people who sit, over the frequency [Hz]: limits of the band at 0.4
    and 100 Hz, the transition from acceleration to velocity at 12.5 Hz, the step upwards at 2.37 and 3.35 Hz.
    """
    s = 2.0j * np.pi * np.maximum(np.asarray(frequency, np.float64), 1e-9)
    w1, w2, w3, w4, w5, w6 = (2.0 * np.pi * f for f in (0.4, 100.0, 12.5, 12.5, 2.37, 3.35))
    q4, q5, q6 = 0.63, 0.91, 0.91
    high = s**2 / (s**2 + np.sqrt(2.0) * w1 * s + w1**2)
    low = w2**2 / (s**2 + np.sqrt(2.0) * w2 * s + w2**2)
    transition = (1.0 + s / w3) / (1.0 + s / (q4 * w4) + (s / w4) ** 2)
    step = (1.0 + s / (q5 * w5) + (s / w5) ** 2) / (1.0 + s / (q6 * w6) + (s / w6) ** 2) * (w5 / w6) ** 2
    return np.asarray(high * low * transition * step)


def weighted(values: Array, dt: float) -> Array:
    """(n,) values through W_k."""
    spectrum = np.fft.rfft(values - values.mean())
    return np.asarray(np.fft.irfft(spectrum * weighting(np.fft.rfftfreq(len(values), dt)), len(values)))


def rms(values: Array) -> float:
    """Root of the mean of the squares about the mean."""
    return float(values.std())


def spectrum(letter: str) -> tuple[Array, Array]:
    """Spatial frequencies [1/m] and the measured density [m³] of a class."""
    length = NODES[0] * SPACING[0]
    rows = []
    for k in range(LINES):
        y = APART * k
        rows.append(random_road(letter, seed=SEED, x=(0.0, length - SPACING[0]), y=(y, y + SPACING[1])).heights[0])
    n, density = signal.welch(np.array(rows, np.float64), 1.0 / SPACING[0], nperseg=SEGMENT, axis=1)
    return n[1:], density.mean(axis=0)[1:]


def straight(speed: float, duration: float) -> Maneuver:
    """Along the x axis at a speed, from the first moment on."""
    line = PathOfRoad(points=np.array([(-30.0, 0.0), (speed * (duration + 1.0) + 60.0, 0.0)]))
    follow = PathTrackingSpec(paths=(line,), speed=speed)
    return Maneuver(name="straight", follow=follow, duration=duration, initial_speed=speed)


def drive(vehicle: str, speed: float, letter: str, picture: Path | None = None) -> dict[str, Any] | None:
    """Rms vertical acceleration of the chassis [m/s²], plain and weighted, and the mean speed [m/s]; None where the
    vehicle does not come to the end.
    """
    way = speed * (DURATION + 1.0)
    road = random_road(letter, seed=SEED, x=(-30.0, way + 30.0), y=(-15.0, 15.0))
    setup = set_up(load_vehicle(vehicle), straight(speed, DURATION), device="cpu", dt=DT, road=road)
    film = None if picture is None else DriveFilm(setup, picture, (1280, 720))
    chassis, rises = setup.vehicle.parts.chassis, []
    run = Drive(setup)
    run.after_step = lambda: rises.append(float(setup.simulation.state.body_v.numpy()[0, chassis, 2]))
    found = run.run()
    if run.left_road is not None or run.broken():
        print(f"{vehicle} on class {letter} at {speed:g} m/s does not come to the end")
        return None
    if film is not None:
        film.write()
    acceleration = (np.diff(rises) / DT)[round((SETTLED + 1.0) / DT) :]
    late = found["t_s"] > SETTLED
    row = {
        "vehicle": vehicle, "road": letter, "speed_mps": float(found["speed_mps"][late].mean()),
        "rms_mps2": rms(acceleration), "weighted_rms_mps2": rms(weighted(acceleration, DT)),
        "least_wheel_load_N": float(min(found[f"Fz_{w}_N"][late].min() for w in ("FL", "FR", "RL", "RR"))),
    }  # fmt: skip
    print("  ".join(f"{key} {value:.4g}" if isinstance(value, float) else str(value) for key, value in row.items()))
    return row


def draw_spectra(axes: Any) -> dict[str, float]:
    """Measured densities over the bands; returns their means over the line of the class."""
    found = {}
    colors = plt.get_cmap("viridis")(np.linspace(0.0, 0.9, len(CLASSES)))
    for color, letter in zip(colors, CLASSES, strict=True):
        n, density = spectrum(letter)
        band = (n > 0.0125) & (n < 2.8)
        middle = displacement_spectrum(n[band], RoadClass(letter))
        axes.fill_between(n[band], 0.5 * middle, 2.0 * middle, color=color, alpha=0.2, linewidth=0)
        axes.loglog(n[band], density[band], color=color, linewidth=0.9)
        axes.annotate(letter, (0.014, float(middle[0])), color=INK, fontsize=10, fontweight="bold", va="center")
        found[letter] = float(np.mean(density[band] / middle))
    axes.set_xlabel("spatial frequency [1/m]", fontsize=9, color=INK)
    axes.set_ylabel("spectral density of the height [m³]", fontsize=9, color=INK)
    title_of(axes, "measured along eight lines of 1024 m; shaded: the bands of ISO 8608")
    return found


def draw_acceleration(axes: Any, rows: list[dict[str, Any]]) -> None:
    """Rms of the vertical acceleration over the class."""
    for (vehicle, speed), color, mark in zip(RUNS, (GREY, BLUE, ORANGE), "s^o", strict=True):
        chosen = [row for row in rows if row["vehicle"] == vehicle and abs(row["speed_mps"] - speed) < 2.0]
        letters = [row["road"] for row in chosen]
        name = f"{vehicle}, {speed:g} m/s"
        axes.semilogy(letters, [row["weighted_rms_mps2"] for row in chosen], f"{mark}-", color=color, label=name)
        axes.semilogy(letters, [row["rms_mps2"] for row in chosen], f"{mark}:", color=color, alpha=0.6)
    for value, text in BOUNDS:
        axes.axhline(value, color=INK, linewidth=0.6, linestyle="--")
        axes.text(0.02, value * 1.04, text, fontsize=7, color=INK, transform=axes.get_yaxis_transform())
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    axes.yaxis.set_minor_formatter("{x:g}")
    axes.tick_params(axis="y", which="minor", labelsize=8, colors=INK)
    axes.set_xlabel("road class", fontsize=9, color=INK)
    axes.set_ylabel("rms vertical acceleration [m/s²]", fontsize=9, color=INK)
    title_of(axes, "of the chassis: weighted by W_k of ISO 2631-1, dotted: plain")
    axes.legend(frameon=False, fontsize=8, loc="lower right")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "images" / "roads.png")
    parser.add_argument("--json", type=Path, default=None)
    arguments = parser.parse_args()
    driven = [drive(vehicle, speed, letter) for vehicle, speed in RUNS for letter in CLASSES]
    rows = [row for row in driven if row is not None]
    figure = plt.figure(figsize=(12.5, 8.0), constrained_layout=True)
    grid = figure.add_gridspec(2, 2, height_ratios=[1.0, 1.05])
    panels = [figure.add_subplot(grid[0, column]) for column in (0, 1)]
    for axes in panels:
        dress(axes)
    ratios = draw_spectra(panels[0])
    draw_acceleration(panels[1], rows)
    below = figure.add_subplot(grid[1, :])
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "road.png"
        drive("hmmwv", 10.0, "E", picture)
        below.imshow(np.asarray(Image.open(picture))[60:-180])
    below.axis("off")
    title_of(below, "the HMMWV on a road of class E")
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(arguments.output, dpi=100)
    print("density over that of the class", {key: round(value, 3) for key, value in ratios.items()})
    print(arguments.output)
    if arguments.json is not None:
        arguments.json.write_text(
            json.dumps({"rows": rows, "density_ratio": ratios}, indent=1) + "\n", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
