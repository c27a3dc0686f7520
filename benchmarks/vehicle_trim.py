"""How the shipped vehicles stand and roll, and how recorded ones stand: `python benchmarks/vehicle_trim.py`.

The tables of docs/bench.md; `--reference FOLDER` adds the second one. FOLDER has recorded runs f_*_accel*.csv in full,
with place and angles.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from pathlib import Path

import numpy as np

from simwarp.vehicle import Drive, Run, load_vehicle, maneuver, set_up, stance, vehicle_names, with_options
from simwarp.vehicle.stances import ROLLING_SPEED, AxleStance
from simwarp.verify.vehicle_cases import cases_in

SETTLED = -0.01
"""Time of a recorded run that is its state at rest, after a second on its brakes [s]."""


def shown(value: float, digits: int) -> str:
    """A number without the sign of a zero."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def stands(axle: AxleStance) -> str:
    """What a row says of an axle at rest."""
    lengths = [(1e3 * line.length, 1e3 * line.free_length) for line in axle.lines if line.free_length]
    springs = ", ".join(f"{length:.1f} of {free:.1f}" for length, free in lengths)
    stops = ", ".join(f"{line.stop} {1e3 * line.into_stop:.1f}" for line in axle.lines if line.stop)
    angles = f"{shown(math.degrees(axle.camber), 2)} | {shown(math.degrees(axle.toe), 2)}"
    heights = f"{axle.ride_height:.4f} | {shown(1e3 * axle.travel, 1)}"
    return f"{heights} | {springs or 'none'} | {stops or 'free'} | {angles}"


def shipped() -> None:
    """A row per axle of every vehicle."""
    columns = (
        "vehicle, axle", "ride height [m]", "wheels over design [mm]", "springs [mm]", "stops [mm]", "camber [°]",
        "toe [°]", "rolling: toe [°]", "force inwards [N]",
    )  # fmt: skip
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    for name in vehicle_names():
        spec = load_vehicle(name)
        standing, rolling = stance(spec), stance(spec, speed=ROLLING_SPEED)
        for index, (axle, other) in enumerate(zip(standing.axles, rolling.axles, strict=True)):
            straight = f"{shown(math.degrees(other.toe), 2)} | {shown(other.side_force, 0)}"
            print(f"| `{name}` {index} | {stands(axle)} | {straight} |")


def settled(run: Run, time: float) -> str:
    """Height and pitch of the frame, toe of the front wheels and loads of the axles at a time."""
    row = {key: float(np.interp(time, run["t_s"], run[key])) for key in run.columns}
    toe = 0.5 * (row["steerangle_FR_rad"] - row["steerangle_FL_rad"])
    loads = [0.5 * (row[f"Fz_{end}L_N"] + row[f"Fz_{end}R_N"]) for end in "FR"]
    angles = f"{math.degrees(row['pitch_rad']):+.2f} | {math.degrees(toe):+.2f}"
    return f"{row['z_m']:.4f} | {angles} | {loads[0]:.0f}, {loads[1]:.0f}"


def recorded(folder: Path) -> None:
    """The state at rest of each recorded start, and ours after the same second."""
    print("| run | | height [m] | pitch [°] | front toe [°] | loads [N] |")
    print("|---|---|---|---|---|---|")
    for case in cases_in(path.stem for path in folder.glob("f_*_accel*.csv")):
        spec = with_options(load_vehicle(case.vehicle), tire=case.tire, powertrain=case.powertrain)
        what = dataclasses.replace(maneuver(case.maneuver, spec), duration=0.01)
        ours = Drive(set_up(spec, what, device="cpu", dt=case.dt)).run()
        print(f"| {case.title} | recorded | {settled(Run.read(folder / f'{case.name}.csv'), SETTLED)} |")
        print(f"| | ours | {settled(ours, SETTLED)} |")


def main() -> None:
    """Both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reference", type=Path, help="folder of recorded runs")
    options = parser.parse_args()
    shipped()
    if options.reference is not None:
        print()
        recorded(options.reference)


if __name__ == "__main__":
    main()
