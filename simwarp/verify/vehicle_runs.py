"""Vehicles against recorded runs of another simulator: speed, yaw, lateral acceleration, wheel loads, gear changes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.verify.check_result import CheckResult, below, near
from simwarp.verify.vehicle_cases import LOADS, Case, low_pass, read_folder, read_shipped

Array = npt.NDArray[np.float64]

SPEED_SHARE = 0.015
"""Of its range."""
YAW_SHARE, LATERAL_SHARE = 0.03, 0.04
"""Of their ranges, in steer runs."""
YAW_RATE, LATERAL = 0.02, 0.15
"""Elsewhere [rad/s, m/s²]."""
LOAD_SHARE = 0.04
"""Of the static load."""
DISTANCE_SHARE = 0.01
SHIFT_TIME = 0.05
"""[s]."""


def vehicles(
    device: str,
    reference: Path | None = None,
    plots: Path | None = None,
    report: Callable[[str], None] | None = None,
) -> list[CheckResult]:
    """Vehicles repeat recorded runs of Project Chrono 10: full throttle, a step of the steering, full brakes.

    Differences are root mean squares over t >= 0 at 100 Hz: of the speed at most 1.5 % of its range; in steer runs of
    the yaw rate 3 % and of speed times yaw rate 4 % of their ranges, elsewhere 0.02 rad/s and 0.15 m/s²; of wheel loads
    behind a low-pass of 10 Hz 4 % of the static load (that of the reference just before t = 0). Distances agree within
    1 %, gear changes within 50 ms. The reference itself moves by that much with its solver's iterations and its step.

    Args:
        device: that runs the engine.
        reference: folder of recorded CSV files; those that are shipped when None.
        plots: folder for one picture per run.
        report: told the name of each run before it begins.
    """
    recorded = read_shipped() if reference is None else read_folder(reference)
    rows: list[CheckResult] = []
    for case, known in recorded.items():
        if report is not None:
            report(case.title)
        ours = repeat(case, device)
        rows += compare(case, known, ours)
        if plots is not None:
            from simwarp.verify.vehicle_plot import draw

            plots.mkdir(parents=True, exist_ok=True)
            draw(case, known, ours, plots / f"{case.name}.png")
    return rows


def repeat(case: Case, device: str, vehicle: VehicleSpec | None = None) -> Run:
    """The run of ours that a recorded one is compared with; of another vehicle than its own, if one is given."""
    spec = vehicle or with_options(load_vehicle(case.vehicle), tire=case.tire, powertrain=case.powertrain)
    return Drive(set_up(spec, maneuver(case.maneuver, spec), device=device, dt=case.dt)).run()


def compare(case: Case, known: Run, ours: Run) -> list[CheckResult]:
    """The rows of one run."""
    scene = f"vehicles: {case.title}"
    begin, end = 0.0, min(known["t_s"][-1], ours["t_s"][-1])
    times = known["t_s"][(known["t_s"] >= begin) & (known["t_s"] <= end + 1e-9)]

    def at(run: Run, name: str) -> Array:
        return np.interp(times, run["t_s"], run[name])

    speed, our_speed = at(known, "speed_mps"), at(ours, "speed_mps")
    yaw, our_yaw = at(known, "yawrate_radps"), at(ours, "yawrate_radps")
    rows = [
        near(scene, "time compared [s]", known["t_s"][-1], end, 0.011),
        below(scene, "speed, RMS [% of range]", 100 * rms(our_speed - speed) / np.ptp(speed), 100 * SPEED_SHARE),
    ]
    yaw_error, lateral_error = rms(our_yaw - yaw), rms(our_yaw * our_speed - yaw * speed)
    if case.maneuver == "reference-steer":
        lateral_range = np.ptp(yaw * speed)
        rows += [
            below(scene, "yaw rate, RMS [% of range]", 100 * yaw_error / np.ptp(yaw), 100 * YAW_SHARE),
            below(scene, "v x yaw rate, RMS [% of range]", 100 * lateral_error / lateral_range, 100 * LATERAL_SHARE),
        ]
    else:
        rows += [
            below(scene, "yaw rate, RMS [rad/s]", yaw_error, YAW_RATE),
            below(scene, "v x yaw rate, RMS [m/s²]", lateral_error, LATERAL),
        ]
    for name in LOADS:
        difference = low_pass(at(ours, name) - at(known, name), times[1] - times[0])
        share = 100 * rms(difference) / static_load(known, name)
        rows.append(below(scene, f"load {name[3:5]}, RMS [% of static]", share, 100 * LOAD_SHARE))
    distance = np.trapezoid(speed, times)
    rows.append(near(scene, "distance [m]", distance, np.trapezoid(our_speed, times), DISTANCE_SHARE * distance))
    return rows + shift_rows(scene, shifts(known, end), shifts(ours, end))


def shift_rows(scene: str, known: Array, ours: Array) -> list[CheckResult]:
    """Rows for the number of gear changes, and for the time of each."""
    rows = [near(scene, "gear changes", len(known), len(ours), 0.0)] if len(known) + len(ours) else []
    if len(known) == len(ours):
        for index, (expected, got) in enumerate(zip(known, ours, strict=True)):
            rows.append(near(scene, f"gear change {index + 1} at [s]", expected, got, SHIFT_TIME))
    return rows


def shifts(run: Run, end: float) -> Array:
    """Times of the gear changes after t = 0 [s]."""
    changed = np.flatnonzero(np.diff(run["gear"]) != 0) + 1
    times = run["t_s"][changed]
    return np.asarray(times[(times > 0.0) & (times <= end)])


def static_load(run: Run, name: str) -> float:
    """Load just before the manoeuvre begins: mean of the last tenth of a second [N]."""
    t = run["t_s"]
    return float(run[name][(t >= -0.1) & (t < 0.0)].mean())


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
