"""The configuration of a fit: what is fitted to which logs, and how."""

from __future__ import annotations

import dataclasses
import enum
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

from simwarp.core import files
from simwarp.core.constraints import (
    Count,
    Ge,
    Gt,
    Le,
    Meaning,
    MinLen,
    NotNegative,
    OneOrMany,
    Positive,
    Rule,
    RuleError,
)
from simwarp.core.schema import Place, Schema
from simwarp.core.types import formatted
from simwarp.core.wording import shortened
from simwarp.identify.fit_error import FitError
from simwarp.vehicle.driving.drawbar import DrawbarSpec

LARGEST: Final = 1.0e15
"""Of a number of a configuration."""

FITS: Final = Schema(FitError, largest=LARGEST)
"""The loader of configurations of fits."""

Name: TypeAlias = Annotated[str, MinLen(1)]
Names: TypeAlias = Annotated[tuple[Name, ...], OneOrMany()]


class Method(enum.Enum):
    """How the least cost is looked for."""

    LM = "lm"
    CMA = "cma"


class Meant(enum.Enum):
    """What a fitted number is: the value itself, a factor of the values as they are, or entries of an inertia."""

    VALUE = "value"
    FACTOR = "factor"
    INERTIA = "inertia"


def _positive_width(prior: Any) -> None:
    if prior is not None and not prior[1] > 0.0:
        raise RuleError("a mean and a standard deviation above 0")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Column:
    """A column of the logs that a reading or an input is taken from.

    Attributes:
        column: its name; that of the reading or input by default.
        unit: of the column, among `simwarp.identify.log_units.UNITS`; SI by default.
        noise: standard deviation of the sensor's noise, in the column's unit. None: it is estimated from what the fit
            leaves over.
        delay: by which a reading is late in the log; by which an input acts later than the log has it [s].
        fit: what of the column is fitted beside the parameters: its `delay`, its `bias`, its `gain`.
        hold: of an input: it stays between samples as it was, as that of a controller does; otherwise it is linear.
    """

    column: str = ""
    unit: str = ""
    noise: Positive | None = None
    delay: Annotated[float, Ge(0.0), Le(10.0), Meaning("seconds")] = 0.0
    fit: Annotated[tuple[Literal["delay", "bias", "gain"], ...], OneOrMany()] = ()
    hold: bool = False

    def __post_init__(self) -> None:
        FITS.hold(self)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LoggedRun:
    """One recorded run.

    Attributes:
        file: one CSV or npz file, or several with columns of one run; from the folder of the configuration.
        name: what reports call it; the first file's by default.
        held_out: it is predicted with the fitted parameters, and not fitted.
        begin, end: times of the log between which it is used [s]; all by default.
        clock: what is added to the times of each file [s].
        start: values of readings at the beginning that the log does not hold, such as `speed_mps = 12`.
    """

    file: Annotated[tuple[Name, ...], OneOrMany(), MinLen(1)]
    name: str = ""
    held_out: bool = False
    begin: float | None = None
    end: float | None = None
    clock: tuple[float, ...] = ()
    start: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        FITS.hold(self)
        if self.clock and len(self.clock) != len(self.file):
            raise FitError(f"clock: must have a number for each of {len(self.file)} files, got {len(self.clock)}")
        if self.begin is not None and self.end is not None and not self.begin < self.end:
            raise FitError(f"end: must be above begin = {self.begin:g} s, got {self.end:g}")

    @property
    def title(self) -> str:
        """What reports call it."""
        return self.name or Path(self.file[0]).stem


@dataclasses.dataclass(frozen=True, kw_only=True)
class Wanted:
    """One parameter that is to be fitted.

    Attributes:
        start: where the fit begins; as the target has it by default (1 of a factor).
        low, high: bounds.
        prior: mean and standard deviation of what is known of it beforehand.
        scale: a change that is large for it; by default a tenth of the bounds' distance, or of the start.
        meant: `value` of one number, `factor` of one or several, `inertia` of one; by what it names by default.
        also: further paths that the same factor acts on.
    """

    start: float | None = None
    low: float | None = None
    high: float | None = None
    prior: Annotated[tuple[float, float] | None, Rule(_positive_width)] = None
    scale: Positive | None = None
    meant: Meant | None = None
    also: Annotated[tuple[Name, ...], OneOrMany()] = ()

    def __post_init__(self) -> None:
        FITS.hold(self)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Search:
    """How the least cost is looked for.

    Attributes:
        method: `lm`, Levenberg and Marquardt; `cma`, an evolution strategy for rough problems (extra `fit`).
        iterations: most of them.
        restarts: how many starts there are: the given one, and others spread about it.
        spread: standard deviation of these, in scales of the parameters.
        seed: of the spread, and of `cma`.
        tolerance: relative fall of the cost in an iteration below which it is over.
        difference: change of a parameter for a difference, in its scale.
        huber: residual from which on errors count by their size in place of their square, in standard deviations of the
            noise; None: all count by their square.
        population: candidates of an iteration of `cma`; None: the library's choice.
    """

    method: Method = Method.LM
    iterations: Count = 30
    restarts: Count = 1
    spread: NotNegative = 1.0
    seed: Annotated[int, Ge(0)] = 0
    tolerance: Annotated[float, Gt(0.0), Le(1.0)] = 1e-6
    difference: Annotated[float, Gt(0.0), Le(1.0)] = 0.05
    huber: Positive | None = None
    population: Annotated[int, Ge(3)] | None = None

    def __post_init__(self) -> None:
        FITS.hold(self)


@dataclasses.dataclass(frozen=True, kw_only=True)
class FitConfig:
    """A fit.

    Attributes:
        target: a vehicle or its file, a robot's or a model's file.
        runs: recorded ones.
        readings: what the model is held to, reading -> column; a word alone is the column's name.
        inputs: what drives the model, input -> column: `steering`, `throttle`, `braking` of a vehicle,
            `joint_force:NAME` or `joint_target:NAME` of a joint.
        parameters: what is fitted: a path in the target's document (`simwarp fit --list TARGET`) -> how.
        time: column of the time.
        dt: step of the simulation [s].
        sample: time between the readings of the model, between which they are linear [s].
        segment: longest piece of a run that is simulated at once; each begins at measured values [s]. None: whole runs.
        warmup: first part of a segment that is simulated and not compared, in which a vehicle settles [s]; by default
            1 s of vehicles, none of others.
        fit_start: values at the beginning of each segment are fitted too; what is measured of them counts as known with
            its noise.
        ground_friction: of the road below a vehicle.
        soil: of a vehicle on soil: the name of a preset; None: a road.
        base: of a robot from a file of another tool: "fixed" or "floating".
        drawbar: the programme of a drawbar test, which all runs are of, in place of inputs; it begins to pull at
            `start` by the clock of the logs.
        search: how.
        folder: that file names start from.
    """

    target: Name
    runs: Annotated[tuple[LoggedRun, ...], MinLen(1)]
    readings: Annotated[Mapping[str, Column], MinLen(1)]
    parameters: Annotated[Mapping[str, Wanted], MinLen(1)]
    inputs: Mapping[str, Column] = dataclasses.field(default_factory=dict)
    time: Column = dataclasses.field(default_factory=lambda: Column(column="t_s"))
    dt: Annotated[float, Gt(0.0), Le(0.1), Meaning("seconds")] = 1.0e-3
    sample: Annotated[float, Gt(0.0), Le(10.0), Meaning("seconds")] = 0.01
    segment: Positive | None = None
    warmup: NotNegative | None = None
    fit_start: bool = False
    ground_friction: Annotated[float, Ge(1e-4), Le(10.0)] = 0.9
    soil: str | None = None
    base: Literal["fixed", "floating"] | None = None
    drawbar: DrawbarSpec | None = None
    search: Search = dataclasses.field(default_factory=Search)
    folder: str = "."

    def __post_init__(self) -> None:
        FITS.hold(self)
        steps = self.sample / self.dt
        if steps < 0.999 or abs(steps - round(steps)) > 1e-6 * steps:
            raise FitError(f"sample: must be a whole multiple of dt = {self.dt:g} s, got {self.sample:g}")
        if all(run.held_out for run in self.runs):
            raise FitError("runs: must have one that is not held out, got none; set held_out = false")
        if self.drawbar is not None:
            self._check_drawbar()

    def _check_drawbar(self) -> None:
        """Every run is the whole test: one programme drives all worlds."""
        if self.inputs:
            told = formatted(next(iter(self.inputs)))
            raise FitError(f"inputs: must be none in a drawbar test, whose carriage and slip drive it, got {told}")
        if self.segment is not None:
            raise FitError(f"segment: must be left out in a drawbar test, got {self.segment:g}; its runs are whole")
        begins = [run.begin for run in self.runs]
        if None in begins or len(set(begins)) > 1:
            told = ", ".join("none" if begin is None else f"{begin:g}" for begin in begins)
            raise FitError(f"runs: must have one and the same begin in a drawbar test, got {told}")

    @property
    def drawbar_test(self) -> DrawbarSpec | None:
        """The drawbar test by the clock of a simulation, which begins where the runs do."""
        begin = self.runs[0].begin
        if self.drawbar is None or begin is None:
            return None
        return dataclasses.replace(self.drawbar, start=self.drawbar.start - begin)

    @property
    def sample_steps(self) -> int:
        """Steps between readings."""
        return round(self.sample / self.dt)

    def path_of(self, name: str) -> Path:
        """A file that the configuration names."""
        return Path(self.folder) / name


def read_fit(path: str | Path) -> FitConfig:
    """The configuration in a TOML or JSON file.

    Raises:
        FitError: it cannot be read, or a value breaks its rule; names file and key.
    """
    path = Path(path)
    name = shortened(path.name)
    try:
        text = files.read_text(path, "configuration")
        value = tomllib.loads(text) if path.suffix == ".toml" else files.parse_json(text, name)
    except files.FileError as error:
        raise FitError(f"{name}: cannot be read: {error.reason or error}") from None
    except tomllib.TOMLDecodeError as error:
        raise FitError(f"{name}: must be TOML: {error}") from None
    if not isinstance(value, dict):
        raise FitError(f"{name}: must be a table of keys, got {formatted(value)}")
    if "folder" in value:
        raise FitError(f"{name}: folder: unknown key; files are looked for beside the configuration")
    return fit_config(value, Place(name, FitError), folder=str(path.parent))


def fit_config(value: Mapping[str, Any], place: Place | None = None, *, folder: str = ".") -> FitConfig:
    """The configuration of plain values, as a file has them.

    Args:
        value: keys of `FitConfig`; a column may be its name alone.
        place: of the values, for errors.
        folder: that file names start from.

    Raises:
        FitError: a value breaks its rule.
    """
    where = Place("fit", FitError) if place is None else place
    plain = dict(value)
    for key in ("readings", "inputs"):
        if isinstance(plain.get(key), Mapping):
            plain[key] = {name: _column(name, entry) for name, entry in plain[key].items()}
    if isinstance(plain.get("time"), str):
        plain["time"] = {"column": plain["time"]}
    made: FitConfig = FITS.load(FitConfig, plain | {"folder": folder}, where.line)
    return made


def _column(name: str, entry: Any) -> Any:
    """The entry of a column with its name."""
    if isinstance(entry, str):
        return {"column": entry}
    if isinstance(entry, Mapping) and "column" not in entry:
        return {**entry, "column": name}
    return entry


def of_target(word: str, *, soil: str | None = None, base: Any = None) -> FitConfig:
    """A configuration that names a target and nothing to fit, to look at the target.

    Args:
        word: a vehicle, or a file of a vehicle, robot or model.
        soil: preset of the soil below a vehicle.
        base: of a robot, "fixed" or "floating".
    """
    return FitConfig(
        target=word, runs=(LoggedRun(file=("log.csv",)),), readings={"speed_mps": Column(column="speed_mps")},
        parameters={"mass": Wanted()}, soil=soil, base=base,
    )  # fmt: skip
