"""Recorded runs that vehicles are held against: which there are, and how they are read and kept.

`vehicle_reference.npz` holds eleven runs of Project Chrono 10, commit 7689fbc (BSD 3-clause), 100 rows per second and
thinned to the columns that are compared: integers, each times the scale of its column. `scripts/pack_vehicle_runs.py`
makes it from a folder of full CSV files.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np

from simwarp.vehicle.results.channels import Array, Run
from simwarp.vehicle.spec.vehicle_spec import SpecError

SHIPPED: Final = Path(__file__).with_name("vehicle_reference.npz")

VEHICLES: Final = {"full": "hmmwv", "reduced": "hmmwv-reduced", "gator": "gator", "artcar": "artcar"}
TIRES: Final = {"PAC89": "pacejka89", "PAC02": "pacejka2002"}
LOADS: Final = ("Fz_FL_N", "Fz_FR_N", "Fz_RL_N", "Fz_RR_N")
CUTOFF: Final = 10.0
"""Of the low-pass that loads are compared behind [Hz]."""
COLUMNS: Final = ("t_s", "speed_mps", "yawrate_radps", "engine_radps", "gear", *LOADS)
"""Columns that are compared or drawn."""

_NAME: Final = re.compile(
    r"f_(?P<vehicle>full|reduced|gator|artcar)_(?P<tire>[A-Z][A-Z0-9]+)(?:_(?P<powertrain>[a-z]+))??"
    r"_(?P<maneuver>accel|steer|brake)(?:_dt(?P<dt>\d+)us)?(?:_it(?P<iterations>\d+))?"
)


@dataclasses.dataclass(frozen=True)
class Case:
    """One recorded run.

    Attributes:
        name: of its file, without the suffix.
        vehicle, tire, maneuver: names of ours.
        powertrain: name of ours; the vehicle's own where None.
        dt: time step [s].
        iterations: of the reference's solver, as far as its name says so.
    """

    name: str
    vehicle: str
    tire: str
    maneuver: str
    powertrain: str | None
    dt: float
    iterations: int

    @property
    def title(self) -> str:
        """For people."""
        parts = [self.vehicle, self.tire, self.powertrain or "", self.maneuver.removeprefix("reference-")]
        step = "" if self.dt == 1e-3 else f"{1e3 * self.dt:g} ms"
        return " ".join(part for part in (*parts, step) if part)


def case_of(name: str) -> Case | None:
    """The run that a file's name (without suffix) denotes; None where it is none that can be compared."""
    match = _NAME.fullmatch(name)
    if match is None or match["tire"] == "RIGID":
        return None
    return Case(
        name, VEHICLES[match["vehicle"]], TIRES.get(match["tire"], match["tire"].lower()),
        f"reference-{match['maneuver']}", match["powertrain"],
        float(match["dt"]) * 1e-6 if match["dt"] else 1e-3, int(match["iterations"] or 0),
    )  # fmt: skip


def cases_in(names: Iterable[str]) -> list[Case]:
    """Of runs that differ in the reference's iterations alone, the one with the most."""
    best: dict[tuple[object, ...], Case] = {}
    for case in filter(None, map(case_of, sorted(names))):
        key = (case.vehicle, case.tire, case.maneuver, case.powertrain, case.dt)
        if key not in best or case.iterations > best[key].iterations:
            best[key] = case
    return list(best.values())


def read_folder(folder: Path) -> dict[Case, Run]:
    """The runs of a folder of CSV files.

    Raises:
        SpecError: there are none, or one cannot be read.
    """
    if not folder.is_dir():
        raise SpecError(f"reference: no folder {folder}")
    cases = cases_in(path.stem for path in folder.glob("f_*.csv"))
    if not cases:
        raise SpecError(f"reference: no recorded run (such as f_full_TMEASY_accel.csv) in {folder}")
    runs = {case: Run.read(folder / f"{case.name}.csv") for case in cases}
    for case, run in runs.items():
        missing = [name for name in COLUMNS if name not in run.columns]
        if missing:
            raise SpecError(f"{case.name}.csv: lacks the column {missing[0]}")
        _check_run(case, run)
    return runs


def _check_run(case: Case, run: Run) -> None:
    """Refuse a record that nothing can be compared with.

    Raises:
        SpecError: it is not finite, not in order, too short, or stands still.
    """
    time = run["t_s"]
    if not all(np.isfinite(run[name]).all() for name in COLUMNS):
        raise SpecError(f"{case.name}.csv: must hold finite numbers")
    if not (np.diff(time) > 0.0).all() or not (time[0] < -0.1 and time[-1] > 0.5):
        raise SpecError(
            f"{case.name}.csv: t_s: must increase from before -0.1 s, where the car stands, to beyond 0.5 s"
        )
    if not np.ptp(run["speed_mps"][time >= 0.0]) > 0.0:
        raise SpecError(f"{case.name}.csv: speed_mps: must change after t = 0")


def read_shipped() -> dict[Case, Run]:
    """The runs that come with this package."""
    runs = {}
    with np.load(SHIPPED) as file:
        for case in cases_in(key for key in file.files if not key.endswith(".scale")):
            # differences along time are smaller, and pack better
            counts = np.cumsum(file[case.name].astype(np.int64), axis=1)
            columns = counts * file[f"{case.name}.scale"][:, None]
            runs[case] = Run(dict(zip(COLUMNS, columns, strict=True)))
    return runs


def low_pass(values: Array, dt: float, cutoff: float = CUTOFF) -> Array:
    """A Butterworth filter of second order [Hz], forwards and backwards: no delay, -6 dB at the cutoff."""
    warped = np.tan(np.pi * cutoff * dt)
    scale = 1.0 / (1.0 + np.sqrt(2.0) * warped + warped**2)
    b0 = scale * warped**2
    a1, a2 = 2.0 * scale * (warped**2 - 1.0), scale * (1.0 - np.sqrt(2.0) * warped + warped**2)
    for _ in range(2):
        filtered = np.empty_like(values)
        x1 = x2 = y1 = y2 = float(values[0])
        for index, x in enumerate(values.tolist()):
            y = b0 * (x + 2.0 * x1 + x2) - a1 * y1 - a2 * y2
            x1, x2, y1, y2 = x, x1, y, y1
            filtered[index] = y
        values = filtered[::-1]
    return values
