"""Reduced vehicles beside full ones, and their speed: `python benchmarks/reduced_vehicles.py --plot reduced.png`.

The table and the picture of docs/reduced.md. `--speed` measures both models in turn on one thread.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Final

import numpy as np

from simwarp.vehicle import Drive, load_vehicle, maneuver, reduced_vehicle_names, set_up
from simwarp.vehicle.results.plot_style import dress, legend, title_of

COURSES: Final = (
    "reference-accel", "reference-steer", "reference-brake", "step-steer", "sine-sweep", "double-lane-change",
)  # fmt: skip
WHEELS: Final = ("FL", "FR", "RL", "RR")
DRAWN: Final = ("reference-brake", "step-steer", "double-lane-change")
"""In the picture."""
STRAIGHT: Final = 0.05
"""Least yaw rate that a deviation is a share of [rad/s]."""
ROUNDS: Final = 12
"""Of timings, of which the fastest counts: other work takes time from all of them."""

Columns = dict[str, np.ndarray]


def driven(name: str, course: str) -> Columns:
    """One manoeuvre from the settled vehicle on."""
    spec = load_vehicle(name)
    run = Drive(set_up(spec, maneuver(course, spec), wheel_bodies=False)).run()
    keep = np.asarray(run.columns["t_s"]) >= 0.0
    return {key: np.asarray(values)[keep] for key, values in run.columns.items()}


def deviation(full: Columns, reduced: Columns, column: str, least: float = 0.0) -> tuple[float, float]:
    """Root mean square and largest difference over the full vehicle's largest value [%]."""
    off = np.abs(reduced[column] - full[column]) / max(float(np.abs(full[column]).max()), least)
    return 100.0 * float(np.sqrt(np.mean(off**2))), 100.0 * float(off.max())


def row(name: str, course: str, full: Columns, reduced: Columns) -> str:
    """A line of the table."""
    cells = [deviation(full, reduced, "speed_mps"), deviation(full, reduced, "yawrate_radps", STRAIGHT)]
    loads = [deviation(full, reduced, f"Fz_{wheel}_N") for wheel in WHEELS]
    cells.append((max(mean for mean, _ in loads), max(most for _, most in loads)))
    return f"| `{name}` | `{course}` | {' | '.join(f'{mean:.2f} ({most:.1f})' for mean, most in cells)} |"


def draw(runs: list[tuple[str, Columns, Columns]], file: Path) -> None:
    """Speed or yaw rate, and loads, of some manoeuvres: full vehicles thick, reduced ones thin."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, grid = plt.subplots(2, len(runs), figsize=(4.0 * len(runs), 5.6), constrained_layout=True)
    for column, (title, full, reduced) in enumerate(runs):
        rates, loads = grid[:, column]
        for axes in (rates, loads):
            dress(axes)
            axes.set_xlabel("t [s]", fontsize=9)
        title_of(rates, f"{title}: yaw rate [°/s]")
        title_of(loads, "wheel loads [kN], front left and right")
        for each, width, colors, label in (
            (full, 3.0, ("#9db7d5", "#e7b79a"), "full"), (reduced, 1.0, ("#1f4e89", "#a03c10"), "reduced"),
        ):  # fmt: skip
            rates.plot(each["t_s"], np.degrees(each["yawrate_radps"]), color=colors[0], linewidth=width, label=label)
            for wheel, color in zip(WHEELS, colors, strict=False):
                loads.plot(each["t_s"], 1e-3 * each[f"Fz_{wheel}_N"], color=color, linewidth=width)
        if column == 0:
            legend(rates)
    figure.savefig(file, dpi=110)


def speeds(name: str, worlds: int) -> None:
    """World-steps per second of both models in turn, of the fastest round."""
    simulations = []
    for vehicle, bodies in ((load_vehicle(name).full_name, True), (name, False), (name, True)):
        spec = load_vehicle(vehicle)
        course = maneuver("step-steer", spec)
        simulation = set_up(spec, course, worlds=worlds, device="cpu", wheel_bodies=bodies).simulation
        simulation.step(4000)
        label = f"{vehicle}, {'wheels are bodies' if bodies else 'no bodies of wheels'}"
        simulations.append((label, simulation, 10 if spec.full_name == vehicle else 80))
    spent = [[] for _ in simulations]  # type: list[list[float]]
    for _ in range(ROUNDS):
        for times, (_, simulation, steps) in zip(spent, simulations, strict=True):
            begin = time.process_time()
            simulation.step(steps)
            times.append((time.process_time() - begin) / (steps * worlds))
    for times, (label, _, _) in zip(spent, simulations, strict=True):
        fastest, usual = min(times), float(np.median(times))
        shares = f"{min(spent[0]) / fastest:.1f} times the full one (median {np.median(spent[0]) / usual:.1f})"
        print(f"{label}: {1.0 / fastest:,.0f} world-steps per second of a core, {shares}")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", nargs="*", default=reduced_vehicle_names())
    parser.add_argument("--courses", nargs="*", default=COURSES)
    parser.add_argument("--plot", type=Path, help="picture of the first vehicle")
    parser.add_argument("--speed", action="store_true", help="measure speeds instead")
    parser.add_argument("--worlds", type=int, default=256)
    options = parser.parse_args()
    if options.speed:
        for name in options.vehicles:
            speeds(name, options.worlds)
        return
    shown = []
    print("| vehicle | manoeuvre | speed | yaw rate | wheel loads |\n|---|---|---|---|---|")
    for name in options.vehicles:
        for course in options.courses:
            full, reduced = driven(load_vehicle(name).full_name, course), driven(name, course)
            print(row(name, course, full, reduced), flush=True)
            if name == options.vehicles[0] and course in DRAWN:
                shown.append((course, full, reduced))
    if options.plot is not None:
        draw(shown, options.plot)


if __name__ == "__main__":
    main()
