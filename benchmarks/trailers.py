"""Trailers against closed forms: `python benchmarks/trailers.py --plot docs/images/trailers.png`.

The picture of docs/trailers.md: paths of the axles of a truck with its semitrailer on a slow circle, beside the circles
on which axles roll that do not slip; growth of the sway of a car's trailer, beside that of the single-track model.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Final

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from simwarp.vehicle import load_vehicle  # noqa: E402
from simwarp.vehicle.driving.drivers import ScriptSpec  # noqa: E402
from simwarp.vehicle.results.plot_style import dress, title_of  # noqa: E402
from tests.physics import test_trailers as trains  # noqa: E402
from tests.reference.trailers import equivalent_wheelbase, trailer_radius  # noqa: E402

STEERING: Final = 0.45
SHIFT: Final = 0.6
"""By which the trailer's load is moved backwards [m]."""
SPEEDS: Final = np.linspace(14.0, 30.0, 33)
DRIVEN: Final = (16.0, 18.0, 20.0, 22.0, 24.0, 26.0, 28.0)


def turn() -> tuple[dict[str, np.ndarray], dict[str, float], np.ndarray]:
    """Paths (n, 2) by the names of the axles, radii by the closed form, and the centre [m]."""
    script = ScriptSpec(steering=((0.0, 0.0), (8.0, 0.0), (14.0, STEERING)), speed=((0.0, 1.0),))
    train = trains.start(load_vehicle("truck-semitrailer"), script, speed=1.0)
    unit = train.spec.units[1]
    assert unit.hitch is not None
    wheelbase = equivalent_wheelbase([unit.hitch.trailer_point[0] - axle.location[0] for axle in unit.axles])
    paths: dict[str, list[np.ndarray]] = {"front axle": [], "rear axle": [], "semitrailer": []}
    for _ in range(600):
        train.sim.step(100)
        middles = train.axle_middles()
        heading = train.heading(1)
        rolls = train.hitch_place()[:2] - wheelbase * np.array([np.cos(heading), np.sin(heading)])
        for name, place in zip(paths, (middles[0, :2], middles[1, :2], rolls), strict=True):
            paths[name].append(place)
    found = trains.turning(train)
    front = float(np.linalg.norm(paths["front axle"][-1] - found.center))
    rear = float(np.linalg.norm(paths["rear axle"][-1] - found.center))
    radii = {
        "front axle": front,
        "rear axle": rear,
        "semitrailer": trailer_radius(found.radius, found.behind, wheelbase),
    }
    ends = {name: float(np.linalg.norm(path[-1] - found.center)) for name, path in paths.items()}
    print(f"semitrailer: radius {ends['semitrailer']:.3f} m, closed form {radii['semitrailer']:.3f} m, "
          f"front axle {front:.3f} m, off-tracking {front - ends['semitrailer']:.3f} m")  # fmt: skip
    return {name: np.array(path) for name, path in paths.items()}, radii, found.center


def main() -> int:
    """Draw the picture and print its figures; exit code 0."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--plot", type=Path, default=Path("trailers.png"), help="picture")
    options = parser.parse_args()
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(12.0, 5.0), layout="constrained")
    paths, radii, center = turn()
    angles = np.linspace(0.0, 2.0 * np.pi, 200)
    for index, (name, path) in enumerate(paths.items()):
        color = f"C{index}"
        left.plot(path[:, 0], path[:, 1], color=color, lw=2.0, label=name)
        circle = center + radii[name] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        if name == "semitrailer":
            left.plot(circle[:, 0], circle[:, 1], color="black", lw=1.0, ls="--", label="axle that does not slip")
    left.set_aspect("equal")
    left.set(xlabel="x [m]", ylabel="y [m]")
    title_of(left, "truck-semitrailer at 1 m/s")
    shipped = load_vehicle("sedan-trailer")
    for name, shift, color in (("as shipped", 0.0, "C0"), (f"load {SHIFT:g} m further behind", SHIFT, "C3")):
        spec = trains.loaded_behind(shipped, shift)
        model = trains.linear_model(spec)
        right.plot(SPEEDS, [model.swaying(speed).real for speed in SPEEDS], color=color, label=f"single track, {name}")
        # as shipped the sway dies within a swing at 16 m/s
        driven = DRIVEN if shift else DRIVEN[1:]
        grown = [trains.swing(trains.sway(spec, speed))[0] for speed in driven]
        right.plot(driven, grown, "o", color=color, label=f"full, {name}")
        for speed, rate in zip(driven, grown, strict=True):
            print(f"{name}: {speed:g} m/s, full {rate:+.3f} 1/s, single track {model.swaying(speed).real:+.3f} 1/s")
        if shift:
            print(f"{name}: critical speed of the single track {model.critical_speed():.2f} m/s")
    right.axhline(0.0, color="black", lw=0.8)
    right.set(xlabel="speed [m/s]", ylabel="growth of the sway [1/s]")
    title_of(right, "sedan-trailer")
    for axes in (left, right):
        dress(axes)
        axes.legend(frameon=False, fontsize=8)
    figure.savefig(options.plot, dpi=110)
    print(f"wrote {options.plot}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
