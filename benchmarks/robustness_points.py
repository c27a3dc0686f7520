"""Conditions in which driving policies are evaluated, as axes and maps, and the rows of what came out."""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import io
import itertools
import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from simwarp.tasks import task_class  # noqa: E402
from simwarp.tasks.driving.conditions import NEUTRAL, SEEN, Conditions  # noqa: E402
from simwarp.train.config import task_config_from_plain  # noqa: E402
from simwarp.train.evaluation.grid import PointResult  # noqa: E402
from simwarp.train.networks.policies import PolicySource  # noqa: E402
from simwarp.train.runs.run_files import append_whole  # noqa: E402
from simwarp.vehicle import load_vehicle, option_names, with_options  # noqa: E402

RESULTS: Final = ROOT / "benchmarks" / "results" / "robustness"
COLUMNS: Final = (
    "digest", "point", "episodes", "successes", "success_low", "success_high", "mean_return", "mean_steps", "reasons",
    "wall_s",
)  # fmt: skip
DRAWN: Final = "conditions=random"
NOMINAL: Final = "nominal"

Row = dict[str, Any]
Changes = Mapping[str, Any]


@dataclasses.dataclass(frozen=True)
class Axis:
    """A condition that is varied.

    Attributes:
        field: of the task's configuration.
        values: of the field.
        label: in pictures and tables, with the unit.
        scale: of the values where they are shown.
        nominal: the value at the nominal point, as it is shown; None: that of the configuration.
    """

    field: str
    values: Sequence[Any]
    label: str
    scale: float = 1.0
    nominal: Any = None

    def value_text(self, value: Any) -> str:
        """A value as tables have it."""
        if isinstance(value, bool):
            return "full" if value else "reduced"
        return f"{value * self.scale:.4g}" if isinstance(value, int | float) else str(value)


DEGREES: Final = 180.0 / math.pi
SUN: Final = (63.435, -36.87)
"""Elevation and azimuth of the sun of `Lighting` [°]."""


def _radians(*degrees: float) -> tuple[float, ...]:
    return tuple(round(math.radians(each), 6) for each in degrees)


AXES: Final = {
    axis.field: axis
    for axis in (
        Axis("friction", (0.3, 0.4, 0.5, 0.6, 0.75, 0.9, 1.1), "friction of the ground"),
        Axis("mass", (0.8, 1.0, 1.2, 1.4, 1.6, 2.0), "mass of the chassis, factor"),
        Axis("light", (0.1, 0.2, 0.35, 0.6, 1.0, 1.5, 2.5), "light, factor"),
        Axis("sun_elevation", _radians(5, 10, 20, 35, 50, SUN[0], 85), "sun above the horizon [°]", DEGREES, SUN[0]),
        Axis("sun_azimuth", _radians(-135, -90, SUN[1], 0, 45, 90, 180), "sun's azimuth [°]", DEGREES, SUN[1]),
        Axis("fog", (0.0, 0.005, 0.01, 0.015, 0.02, 0.03, 0.05), "fog [1/m]"),
        Axis("image_noise", (0.0, 0.01, 0.02, 0.05, 0.1, 0.2), "noise of a pixel's value"),
        Axis("contrast", (0.4, 0.55, 0.7, 0.85, 1.0, 1.15, 1.3, 1.6), "contrast, factor"),
        Axis("image_delay", (0, 1, 2, 3), "delay of the image [control steps]"),
        Axis("action_delay", (0, 1, 2, 3), "delay of the actions [control steps]"),
        Axis("tires", (), "tire model", nominal="own"),
        Axis("full", (False, True), "model of the vehicle"),
    )
}


@dataclasses.dataclass(frozen=True)
class Map:
    """Two conditions that are varied together.

    Attributes:
        down, across: fields.
        rows, columns: values of them.
    """

    down: str
    rows: Sequence[Any]
    across: str
    columns: Sequence[Any]

    def changes(self) -> list[list[Changes]]:
        """What is changed in each cell."""
        return [[{self.down: one, self.across: other} for other in self.columns] for one in self.rows]


MAPS: Final = {
    "friction-mass": Map("friction", (0.3, 0.5, 0.75, 0.9), "mass", (0.8, 1.0, 1.4, 2.0)),
    "fog-light": Map("fog", (0.0, 0.01, 0.02, 0.03), "light", (0.2, 0.6, 1.0, 1.5)),
    "delays": Map("image_delay", (0, 1, 2), "action_delay", (0, 1, 2)),
}


def thinned(axis: Axis, count: int) -> Axis:
    """Return an axis with `count` of its numbers, both ends among them; models of tires and vehicles are all kept."""
    values = axis.values
    if len(values) <= count or not all(isinstance(value, int | float) for value in values):
        return axis
    places = [round(at * (len(values) - 1) / (count - 1)) for at in range(count)]
    return dataclasses.replace(axis, values=tuple(values[place] for place in places))


def axes_of_task(task: str, obs: str, wanted: Sequence[str]) -> dict[str, Axis]:
    """Return the axes that say something about a task: none of the camera by state, tires that there are."""
    found = {}
    cls: Any = task_class(task)
    for name in wanted:
        axis = AXES[name]
        if obs != "camera" and name in (*SEEN, "image_delay"):
            continue
        if name == "tires":
            axis = dataclasses.replace(axis, values=("own", *other_tires(cls)))
        if name == "full" and cls.vehicle_name == cls.full_name:
            continue
        found[name] = axis
    return found


def other_tires(cls: Any) -> list[str]:
    """Return the names of the tires that are shipped for a task's vehicle, but for its own and those without a law."""
    spec = load_vehicle(cls.vehicle_name)
    own = spec if cls.tire is None else with_options(spec, tire=cls.tire)
    names = [name for name in option_names(cls.vehicle_name, "tire") if "rigid" not in name and name != "flexible"]
    return [name for name in names if with_options(spec, tire=name).axles != own.axles]


def nominal_config(source: PolicySource, task: str) -> Any:
    """Return the configuration that a policy was trained with, at the nominal point of all conditions.

    Worlds that `simwarp train` begins with in place of those of an evaluation, such as harder ones, are set aside.
    """
    cls = task_class(task)
    config: Any = task_config_from_plain(cls, source.content["task_config"], f"checkpoint {source.path}: task_config")
    plain, worlds = cls.config_type(), cls.trained_in.keys() - {"conditions"}
    usual = {
        name: getattr(plain, name)
        for name in (*NEUTRAL, "friction", "tires", "full", "soil", "randomise", "sensing", "curriculum", *worlds)
    }
    return dataclasses.replace(config, conditions=Conditions.NOMINAL, **usual)


def changed(config: Any, changes: Changes) -> Any:
    """Return a configuration with some conditions changed, as they stand in `AXES`."""
    given: dict[str, Any] = dict(changes)
    if "action_delay" in given:
        given["action_delay"] = (given["action_delay"],) * 2
    if given.get("tires") == "own":
        given["tires"] = None
    if "conditions" in given:
        given["conditions"] = Conditions(given["conditions"])
    return dataclasses.replace(config, **given)


def nominal_value(config: Any, axis: Axis) -> Any:
    """Return the value of an axis at the nominal point."""
    if axis.nominal is not None:
        return _radians(axis.nominal)[0] if axis.scale == DEGREES else axis.nominal
    value = getattr(config, axis.field)
    return value[0] if isinstance(value, tuple) else value


def key_of(config: Any, changes: Changes) -> str:
    """Return the name of a point: what differs from the nominal one, in the order of `AXES`."""
    if "conditions" in changes:
        return DRAWN
    parts = []
    for name, axis in AXES.items():
        if name not in changes:
            continue
        if changes[name] != nominal_value(config, axis):
            parts.append(f"{name}={changes[name]}")
    return " ".join(parts) or NOMINAL


def wanted_points(config: Any, axes: Mapping[str, Axis], maps: Sequence[str]) -> dict[str, Changes]:
    """Return the points, each once: name -> what is changed. The nominal one and the drawn one come first."""
    changes: Changes
    points: dict[str, Changes] = {NOMINAL: {}, DRAWN: {"conditions": "random"}}
    for name, axis in axes.items():
        for value in axis.values:
            changes = {name: value}
            points.setdefault(key_of(config, changes), changes)
    for name in maps:
        if MAPS[name].down in axes and MAPS[name].across in axes:
            for changes in itertools.chain(*MAPS[name].changes()):
                points.setdefault(key_of(config, changes), changes)
    return points


# ---- rows -----------------------------------------------------------------------------------------------------------


def path_of(task: str, obs: str, label: str) -> Path:
    """Return the file of a policy's rows."""
    return RESULTS / f"{task}.{obs}.{label}.csv"


def read_rows(path: Path, digest: str | None = None) -> dict[str, Row]:
    """Return the rows of a file, by point: those of a policy, or without a digest of the last one that was evaluated.

    Of two rows of a point the one with more episodes counts.
    """
    if not path.exists():
        return {}
    with path.open(encoding="utf-8") as file:
        # One that was cut off while it was written is none
        rows = [row for row in csv.DictReader(file) if all(row.get(name) for name in COLUMNS)]
    digest = rows[-1]["digest"] if digest is None and rows else digest
    found: dict[str, Row] = {}
    for text in rows:
        row = {name: text[name] if name in ("digest", "point", "reasons") else float(text[name]) for name in COLUMNS}
        known = found.get(text["point"])
        if text["digest"] == digest and (known is None or known["episodes"] <= row["episodes"]):
            found[text["point"]] = row
    return found


def write_row(path: Path, digest: str, point: str, result: PointResult) -> None:
    """Add the row of a point to a file."""
    value = result.evaluation
    low, high = value.success_ci95
    values = (
        digest, point, value.episodes, round(value.success_rate * value.episodes), round(low, 4), round(high, 4),
        round(value.mean_return, 4), round(value.mean_episode_length, 2), json.dumps(value.end_reasons),
        round(result.seconds, 1),
    )  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if not path.exists() or not path.stat().st_size:
        writer.writerow(COLUMNS)
    writer.writerow(values)
    append_whole(path, text.getvalue().encode())


def digest_of(source: PolicySource) -> str:
    """Return what tells a policy from others: the beginning of its file's hash."""
    return hashlib.sha256(source.path.read_bytes()).hexdigest()[:12]
