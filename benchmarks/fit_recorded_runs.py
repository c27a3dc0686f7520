"""Vehicles fitted to some recorded runs of the reference predict its others: `python -m benchmarks.fit_recorded_runs`.

A fit begins at a vehicle whose numbers are wrong, and is told the recorded readings of some manoeuvres. The vehicle as
it was and as it was fitted then drives all manoeuvres, those that the fit never saw too, and is held against the
records with the bounds of `simwarp verify vehicles`.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.warp_start import start_warp
from simwarp.identify import Fit, FitConfig, FitResult, fit_config
from simwarp.identify.fit_report import content_of, unidentified
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.plot_style import BLUE, INK, ORANGE, legend
from simwarp.vehicle.rigs.rig_plots import label_axes, plot_page
from simwarp.vehicle.spec.parts import SPECS
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_spec import SpecError, VehicleSpec
from simwarp.verify.check_result import CheckResult
from simwarp.verify.vehicle_cases import LOADS, case_of, low_pass
from simwarp.verify.vehicle_runs import compare, repeat

RECORDED: Final = Path(__file__).parents[2] / "shared" / "reference" / "chrono"
"""Folder of the recorded runs, beside the project."""
DT: Final = 0.002
SAMPLE: Final = 0.02
READINGS: Final = {
    "speed_mps": 0.05, "yawrate_radps": 0.005, "latacc_com_mps2": 0.1, "engine_radps": 5.0, "pitch_rad": 0.001,
    "roll_rad": 0.001,
}  # fmt: skip
"""What the fit is told, and the standard deviations of such sensors, in SI."""
DRAWN: Final = {"speed_mps": "speed [m/s]", "yawrate_radps": "yaw rate [rad/s]", "Fz_FL_N": "load front left [N]"}
"""Columns of the pictures, and what stands above them."""
LINES: Final = ((INK, "recorded", 3.0), (ORANGE, "before", 1.2), (BLUE, "after", 1.2))
"""Colours, names and widths of the runs of a picture."""
SAMPLE_OF_RUNS: Final = 0.01
"""Time between the rows of records and of runs [s]."""
INPUTS: Final = {"steering": "steer", "throttle": "throttle", "braking": "brake"}
AT_REST: Final = {"speed_mps": 0.0}
MASS, CENTER, YAW_INERTIA = (f"chassis.components[0].{key}" for key in ("mass", "com[0]", "inertia[2]"))
SPRING, DAMPER = "suspension.springs[0].spring_curve", "suspension.springs[1].damper_map"
WEIGHED: Final = {"start": 2086.52, "prior": [2086.52, 10.0]}
"""A mass that a weighbridge told: without it forces and masses are known by their ratio alone."""


@dataclasses.dataclass(frozen=True)
class Proof:
    """What is fitted to which records.

    Attributes:
        vehicle: a shipped one.
        fitted: names of the records that are fitted, with the first and the last time that is used [s].
        held_out: names of those that are only predicted.
        parameters: as in the configuration of a fit, with the numbers of the wrong vehicle as starts.
    """

    vehicle: str
    fitted: Mapping[str, tuple[float, float]]
    held_out: Sequence[str]
    parameters: Mapping[str, Mapping[str, Any]]


ACCEL, STEER, BRAKE = (f"f_full_TMEASY_{name}_it500" for name in ("accel", "steer", "brake"))
CHASSIS: Final[dict[str, dict[str, Any]]] = {
    MASS: WEIGHED,
    CENTER: {"start": -0.05, "low": -0.5, "high": 0.5},
    YAW_INERTIA: {"start": 2900.0, "low": 1500.0, "high": 6000.0},
    f"axles[0].{SPRING}": {"start": 0.85, "also": "axles[0].suspension.springs[0].bump_curve"},
    f"axles[1].{SPRING}": {"start": 1.15, "also": "axles[1].suspension.springs[0].bump_curve"},
    f"axles[*].{DAMPER}": {"start": 0.8, "also": "axles[*].suspension.springs[1].damper_curve"},
    "axles[*].tire.parameters.slope_y": {"start": 0.8, "low": 0.3, "high": 2.0},
    "engine.torque": {"start": 0.88, "low": 0.5, "high": 1.5},
    "steerings[0].steering.max_angle": {"start": 0.46, "low": 0.3, "high": 0.8},
    "axles[*].brake.max_torque": {"low": 0.5, "high": 1.5},
}
"""Ten numbers; the brakes are those of the vehicle, which the first two logs cannot tell."""
ALONG: Final = (MASS, CENTER, f"axles[0].{SPRING}", f"axles[1].{SPRING}", f"axles[*].{DAMPER}", "engine.torque")
STRAIGHT: Final[dict[str, dict[str, Any]]] = {
    **{name: CHASSIS[name] for name in ALONG},
    "axles[*].brake.max_torque": {"start": 0.8, "low": 0.5, "high": 1.5},
    "axles[*].tire.parameters.slope_y": {"low": 0.3, "high": 2.0},
    "steerings[0].steering.max_angle": {"low": 0.3, "high": 0.8},
}
"""Nine numbers; what turns the vehicle is as it is, which logs of straight runs cannot tell."""
FIALA, PACEJKA = "f_full_FIALA_steer", "f_full_PAC89_accel"
PROOFS: Final = {
    "hmmwv": Proof("hmmwv", {ACCEL: (-0.98, 6.0), STEER: (13.5, 19.0)}, [BRAKE, FIALA, PACEJKA], CHASSIS),
    "hmmwv-straight": Proof("hmmwv", {ACCEL: (-0.98, 6.0), BRAKE: (18.5, 22.5)}, [STEER], STRAIGHT),
}
"""By what is named on the command line."""


def configuration(proof: Proof, folder: Path, iterations: int) -> FitConfig:
    """The fit, of records in a folder."""
    return fit_config(
        {
            "target": proof.vehicle, "dt": DT, "sample": SAMPLE,
            "runs": [
                {"file": f"{name}.csv", "begin": begin, "end": end, "start": AT_REST if begin < 0.0 else {}}
                for name, (begin, end) in proof.fitted.items()
            ],
            "readings": {name: {"noise": noise} for name, noise in READINGS.items()}, "inputs": INPUTS,
            "parameters": proof.parameters, "search": {"iterations": iterations, "tolerance": 1e-3, "huber": 3.0},
        },
        folder=str(folder),
    )  # fmt: skip


def vehicle_at(fit: Fit, values: npt.NDArray[np.float64]) -> VehicleSpec:
    """The vehicle with some values of the parameters."""
    document = fit.target.saved(fit.parameters.changed(values))
    made: VehicleSpec = SPECS.load(VehicleSpec, document)
    return made


def driven(name: str, spec: VehicleSpec, device: str) -> Run:
    """The manoeuvre of a record, driven by a vehicle: on the record's tires where these are other ones."""
    case = case_of(name)
    if case is None:
        raise SpecError(f"{name}: must be a recorded run such as f_full_TMEASY_accel")
    own = spec.axles[0].tire.template
    return repeat(case, device, spec if case.tire == own else with_options(spec, tire=case.tire))


def check_rows(name: str, held_out: bool, known: Run, before: Run, after: Run) -> list[dict[str, Any]]:
    """A row per quantity of a record: the bound, and the errors of the vehicle before and after the fit."""
    case = case_of(name)
    assert case is not None
    first = {row.quantity: row for row in compare(case, known, before)}
    rows = []
    for row in compare(case, known, after):
        beside = first.get(row.quantity)
        rows.append({
            "run": name, "held_out": held_out, "quantity": row.quantity, "bound": row.tolerance,
            "before": None if beside is None else error_of(beside), "after": error_of(row), "pass": row.passed,
        })  # fmt: skip
    return rows


def title_of(name: str) -> str:
    """A record for people: its tires and its manoeuvre."""
    case = case_of(name)
    assert case is not None
    return f"{case.tire}, {case.maneuver.removeprefix('reference-')}"


def error_of(row: CheckResult) -> float:
    """How far a quantity is from that of the record."""
    return abs(row.got - row.expected)


def proof_of(proof: Proof, iterations: int, threads: int | None, picture: Path | None = None) -> dict[str, Any]:
    """Fit, drive all manoeuvres before and after, compare, and draw those that were held out."""
    begin = time.perf_counter(), time.process_time()
    fit = Fit(configuration(proof, RECORDED, iterations), device="cpu", threads=threads)
    result = fit.run(on_progress=lambda at: print(f"  iteration {at.iteration}: cost {at.cost:.6g}", flush=True))
    seconds = {"wall": time.perf_counter() - begin[0], "cpu": time.process_time() - begin[1]}
    print_fit(result, seconds)
    before, after = (vehicle_at(fit, values) for values in (result.starts, result.values))
    rows, drawn = [], {}
    for name in (*proof.fitted, *proof.held_out):
        known = Run.read(RECORDED / f"{name}.csv")
        runs = known, driven(name, before, "cpu"), driven(name, after, "cpu")
        found = check_rows(name, name in proof.held_out, *runs)
        print_checks(found)
        rows += found
        if name in proof.held_out:
            drawn[title_of(name)] = runs
    if picture is not None:
        draw_runs(drawn, picture, f"{proof.vehicle}: predicted manoeuvres, before and after a fit to others")
    return {**content_of(result), "vehicle": proof.vehicle, "seconds": seconds, "checks": rows}


def print_fit(result: FitResult, seconds: Mapping[str, float]) -> None:
    """What was fitted, and what the logs do not tell."""
    for row in result.rows():
        ends = "not told" if not row["identifiable"] else f"{row['low']:.5g} to {row['high']:.5g}"
        print(f"{row['name']:<45} start {row['start']:8.5g}  fitted {row['value']:8.5g}  {ends}")
    for line in unidentified(result):
        print(f"not told: {line}")
    told = f"{seconds['wall']:.0f} s, {seconds['cpu']:.0f} s of CPU, {result.iterations} iterations"
    print(f"{told}, cost {result.first_cost:.6g} -> {result.cost:.6g}: {result.reason}")


def print_checks(rows: Sequence[Mapping[str, Any]]) -> None:
    """The errors of one record beside their bounds."""
    for row in rows:
        what = f"{row['run']}{' (held out)' if row['held_out'] else ''}: {row['quantity']}"
        before = "  other" if row["before"] is None else f"{row['before']:7.3g}"
        mark = "" if row["pass"] else "  beyond"
        print(f"{what:<80} before {before}  after {row['after']:7.3g}  bound {row['bound']:.3g}{mark}", flush=True)


def draw_runs(runs: Mapping[str, tuple[Run, Run, Run]], target: Path, title: str) -> None:
    """Write a page with a row for each manoeuvre: as recorded, and as driven before and after the fit."""
    size = (4.6 * len(DRAWN), 2.8 * len(runs) + 0.6)
    with plot_page(target, title, len(runs), len(DRAWN), size) as panels:
        for row, (title_of_run, each) in zip(panels, runs.items(), strict=True):
            for axes, name in zip(row, DRAWN, strict=True):
                for run, (color, label, width) in zip(each, LINES, strict=True):
                    shown = run["t_s"] >= 0.0
                    values = low_pass(run[name], SAMPLE_OF_RUNS) if name in LOADS else run[name]
                    axes.plot(run["t_s"][shown], values[shown], color=color, label=label, linewidth=width)
                label_axes(axes, title_of_run, "t [s]")
                axes.set_ylabel(DRAWN[name], fontsize=8, color=INK)
                legend(axes)


def main() -> None:
    """Fit, compare, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("proofs", nargs="*", choices=[*PROOFS, []], default=[], help="all by default")
    parser.add_argument("--iterations", type=int, default=25)
    parser.add_argument("--threads", type=int, default=None)
    parser.add_argument("--json", type=Path, default=None, help="file of all rows; those of other proofs stay")
    parser.add_argument("--picture", type=Path, default=None, help="of the predicted manoeuvres of the first proof")
    given = parser.parse_args()
    if not RECORDED.is_dir():
        raise SystemExit(f"fit_recorded_runs: needs the recorded runs of the reference in {RECORDED}")
    start_warp()
    kept = given.json is not None and given.json.is_file()
    found = json.loads(given.json.read_text(encoding="utf-8")) if kept else {}
    for name in given.proofs or PROOFS:
        print(f"{name}:", flush=True)
        picture = given.picture if name == next(iter(PROOFS)) else None
        found[name] = proof_of(PROOFS[name], given.iterations, given.threads, picture)
    if given.json is not None:
        given.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
