"""A fit from its configuration to its result, batch by batch, so that it can be stopped and go on."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core import files
from simwarp.identify.document_numbers import is_number, numbers_in, patch_of, path_of
from simwarp.identify.fit_config import FitConfig, Method, of_target
from simwarp.identify.fit_error import FitError
from simwarp.identify.fit_problem import FitProblem
from simwarp.identify.fitted_parameters import FittedParameters
from simwarp.identify.identifiability import Uncertainty, uncertainty_of
from simwarp.identify.levenberg_marquardt import LevenbergMarquardt, SearchSpace, cost_of
from simwarp.identify.log_checks import check_speed
from simwarp.identify.logs import RunLog, read_run
from simwarp.identify.model_target import ModelTarget, is_model_file
from simwarp.identify.vehicle_target import VehicleTarget
from simwarp.identify.world_numbers import Target

Array = npt.NDArray[np.float64]

STATE_VERSION: Final = 1
"""Of files of unfinished fits."""


@dataclasses.dataclass(frozen=True)
class Progress:
    """Where a fit is.

    Attributes:
        iteration: batches so far.
        cost: the least one so far.
        worlds_diverged: worlds that broke down so far.
        values: of the parameters at the least cost.
    """

    iteration: int
    cost: float
    worlds_diverged: int
    values: dict[str, float]


@dataclasses.dataclass(frozen=True)
class FittedReading:
    """One reading of one run, measured and as the model has it.

    Attributes:
        run, reading: names.
        held_out: whether the run was only predicted.
        time: (n,) [s].
        measured, predicted: (n,) in SI.
    """

    run: str
    reading: str
    held_out: bool
    time: Array
    measured: Array
    predicted: Array

    @property
    def rms(self) -> float:
        """Root of the mean square of what is left over."""
        return float(np.sqrt(np.mean((self.predicted - self.measured) ** 2)))


@dataclasses.dataclass(frozen=True)
class FitResult:
    """The end of a fit.

    Attributes:
        names, values: of the unknowns.
        starts: where they began.
        uncertainty: of them.
        count: how many of them are parameters; behind are poses and starts of segments.
        cost: half the sum of squares (or of Huber's loss) of all residuals, in standard deviations.
        first_cost: at the start.
        iterations: batches that were simulated.
        reason: why it ended.
        diverged: worlds that broke down.
        readings: fitted and held-out ones.
        document: the target's file with the fitted numbers.
        patch: what of it differs.
    """

    names: tuple[str, ...]
    values: Array
    starts: Array
    uncertainty: Uncertainty
    count: int
    cost: float
    first_cost: float
    iterations: int
    reason: str
    diverged: int
    readings: tuple[FittedReading, ...]
    document: Any
    patch: Any

    def __getitem__(self, name: str) -> float:
        """A fitted value by its name."""
        return float(self.values[self.names.index(name)])

    def rows(self) -> list[dict[str, Any]]:
        """A row per parameter: name, value, ends of its interval, whether the data tell it."""
        found = self.uncertainty
        return [
            {
                "name": name, "value": float(self.values[index]), "low": _number(found.low[index]),
                "high": _number(found.high[index]), "identifiable": bool(found.identifiable[index]),
                "start": float(self.starts[index]), "influence": not bool(found.without_influence[index]),
            }
            for index, name in enumerate(self.names[: self.count])
        ]  # fmt: skip


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


class Fit:
    """Parameters of a target from recorded runs.

    Args:
        config: what is fitted to what.
        device: of the simulations.
        threads: of a CPU; None: all. The result does not depend on them.
        target: in place of the one that the configuration names.

    Attributes:
        problem: the runs that are fitted.
        parameters: what is fitted of the target and of columns.

    Raises:
        FitError: the configuration, a log or the target does not fit; one line.
    """

    def __init__(
        self, config: FitConfig, *, device: str | None = None, threads: int | None = None, target: Target | None = None
    ) -> None:  # fmt: skip
        self.config = config
        self.target = load_target(config, device, threads) if target is None else target
        self.parameters = FittedParameters(config, self.target.document)
        self.target.check_names(tuple(config.readings), tuple(config.inputs))
        runs = [read_run(config, run) for run in config.runs]
        for run in runs:
            check_speed(run)
        self._held_out = [run for run in runs if run.config.held_out]
        fitted = [run for run in runs if not run.config.held_out]
        self.problem = FitProblem(config, self.target, fitted, self.parameters)
        self.problem.probe()
        self._searches = [self._search(start) for start in self._starting_points()]
        self._first_cost = math.inf
        self._digest = _digest(config, runs)

    def _starting_points(self) -> list[Array]:
        """The given start, and others about it."""
        unknowns, search = self.problem.unknowns, self.config.search
        first = self.problem.starts
        rng = np.random.default_rng(search.seed)
        scale = np.array([each.scale if each.segment < 0 else 0.0 for each in unknowns])
        others = [first + search.spread * scale * rng.standard_normal(len(first)) for _ in range(search.restarts - 1)]
        return [first, *others]

    def _search(self, start: Array) -> Any:
        search, unknowns = self.config.search, self.problem.unknowns
        space = SearchSpace(
            start=start, low=np.array([each.low for each in unknowns]), high=np.array([each.high for each in unknowns]),
            scale=np.array([each.scale for each in unknowns]), difference=search.difference, tolerance=search.tolerance,
            iterations=search.iterations, huber=math.inf if search.huber is None else search.huber,
            signed=np.array([each.signed for each in unknowns], bool),
        )  # fmt: skip
        if search.method is Method.CMA:
            from simwarp.identify.evolution import EvolutionThenLeastSquares

            return EvolutionThenLeastSquares(space, seed=search.seed, population=search.population)
        return LevenbergMarquardt(space)

    # ---- running -----------------------------------------------------------------------------------------------------

    @property
    def done(self) -> bool:
        """Whether all searches are over."""
        return all(search.done for search in self._searches)

    @property
    def iteration(self) -> int:
        """Batches so far."""
        return max(int(search.iteration) for search in self._searches)

    def iterate(self) -> Progress:
        """Simulate one batch: the points of all searches that go on.

        Raises:
            FitError: the model diverges where the fit begins.
        """
        active = [search for search in self._searches if not search.done]
        asked = [search.ask() for search in active]
        residuals = self.problem.residuals(np.concatenate(asked))
        if self.iteration == 0:
            self._first_cost = float(cost_of(residuals[0], active[0].space.huber))
            if not math.isfinite(self._first_cost):
                raise FitError(
                    f"target: '{self.target.name}' must not diverge at the start of the fit, got values that are not "
                    "finite; take a smaller dt, or other starts"
                )
        ends = np.cumsum([0, *map(len, asked)]).tolist()
        for search, begin, end in zip(active, ends[:-1], ends[1:], strict=True):
            search.tell(residuals[begin:end])
        return self.progress()

    def progress(self) -> Progress:
        """Where the fit is."""
        best = self._best()
        names = [each.name for each in self.parameters.unknowns]
        values = dict(zip(names, best.point.tolist(), strict=False))
        return Progress(self.iteration, best.cost, self.problem.diverged, values)

    def run(
        self, *, on_progress: Callable[[Progress], None] | None = None, stop: Callable[[], bool] = lambda: False,
        state: str | Path | None = None,
    ) -> FitResult:  # fmt: skip
        """Iterate to the end, or until it is stopped, and return the best that was found.

        Args:
            on_progress: called after every batch.
            stop: asked after every batch.
            state: file that is written after every batch, for `resume`.
        """
        while not self.done:
            progress = self.iterate()
            if state is not None:
                self.save(state)
            if on_progress is not None:
                on_progress(progress)
            if stop():
                break
        return self.result()

    def _best(self) -> Any:
        return min(self._searches, key=lambda search: float(search.cost))

    # ---- to go on later ----------------------------------------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Write where the fit is to an npz file."""
        arrays: dict[str, Any] = {}
        numbers = []
        for index, search in enumerate(self._searches):
            values = search.state()
            arrays |= {f"{index}.{name}": value for name, value in values.items() if isinstance(value, np.ndarray)}
            numbers.append({name: value for name, value in values.items() if not isinstance(value, np.ndarray)})
        about = {
            "version": STATE_VERSION, "digest": self._digest, "first_cost": self._first_cost,
            "diverged": self.problem.diverged, "searches": numbers,
        }  # fmt: skip
        with files.replacing(path) as draft, draft.open("wb") as file:
            np.savez(file, about=np.array(json.dumps(about)), **arrays)

    def resume(self, path: str | Path) -> None:
        """Go on from a file of `save`: all that follows is as if the fit had never stopped.

        Raises:
            FitError: it cannot be read, or is of another fit.
        """
        try:
            with np.load(files.check_input(path, "state"), allow_pickle=False) as archive:
                about = json.loads(str(archive["about"]))
                arrays = {name: archive[name] for name in archive.files if name != "about"}
        except files.FileError as error:
            raise FitError(f"{path}: cannot be read: {error.reason or error}") from None
        except (OSError, ValueError, KeyError) as error:
            raise FitError(f"{path}: must be the state of a fit, got {error}") from None
        if about["version"] != STATE_VERSION or about["digest"] != self._digest:
            raise FitError(f"{path}: must be of the same configuration and logs, got another fit; start it anew")
        self._first_cost, self.problem.diverged = float(about["first_cost"]), int(about["diverged"])
        for index, (search, numbers) in enumerate(zip(self._searches, about["searches"], strict=True)):
            own = {name.partition(".")[2]: value for name, value in arrays.items() if name.startswith(f"{index}.")}
            search.restore(numbers | own)

    # ---- result ------------------------------------------------------------------------------------------------------

    def result(self) -> FitResult:
        """What was found so far.

        Raises:
            FitError: nothing was simulated yet.
        """
        best = self._best()
        if not math.isfinite(best.cost):
            raise FitError("fit: no batch was simulated yet; call iterate first")
        unknowns, problem = self.problem.unknowns, self.problem
        known = [self.config.readings[name].noise is not None for name in problem.readings]
        scale = np.array([each.scale for each in unknowns])
        uncertainty = uncertainty_of(best.point, scale, best.jacobian, best.residuals, problem.groups, known)
        document = self.target.saved(self.parameters.changed(best.point))
        return FitResult(
            names=tuple(each.name for each in unknowns), values=best.point.copy(), starts=problem.starts,
            uncertainty=uncertainty, count=len(self.parameters.unknowns), cost=best.cost, first_cost=self._first_cost,
            iterations=self.iteration, reason=best.reason or "it was stopped", diverged=problem.diverged,
            readings=(*self._readings(problem, best.point, False), *self._predicted(best.point)),
            document=document, patch=patch_of(self.target.saved(self.target.document), document),
        )  # fmt: skip

    def _predicted(self, point: Array) -> list[FittedReading]:
        """Readings of the runs that are held out: their poses are measured, all else is as it was fitted."""
        if not self._held_out:
            return []
        held = FitProblem(self.config, self.target, self._held_out, self.parameters, fitted=False)
        held.share_differences_of(self.problem)
        return self._readings(held, point[: len(self.parameters.unknowns)], True)

    @staticmethod
    def _readings(problem: FitProblem, point: Array, held_out: bool) -> list[FittedReading]:
        records = problem.simulate(point[None])[0]
        found = []
        for index, name in enumerate(problem.readings):
            for number, run in enumerate(problem.runs):
                own = [piece for piece, each in enumerate(problem.pieces) if each.segment.run == number]
                predicted = [problem.predicted(point, piece, index, records[piece]) for piece in own]
                measured = [problem.compared(piece, index) for piece in own]
                times = [problem.pieces[piece].measured[index].time for piece in own]
                arrays = (np.concatenate(each) for each in (times, measured, predicted))
                found.append(FittedReading(run.config.title, name, held_out, *arrays))
        return found


def load_target(config: FitConfig, device: str | None = None, threads: int | None = None) -> Target:
    """The vehicle, robot or model that a configuration names."""
    if is_model_file(config.path_of(config.target)):
        return ModelTarget(config, device, threads)
    return VehicleTarget(config, device, threads)


def list_parameters(word: str, *, soil: str | None = None, base: Any = None) -> list[dict[str, Any]]:
    """Rows of all that can be fitted of a target: name, value, low, high, identifiable (not known before a fit).

    Args:
        word: a vehicle, or a file of a vehicle, robot or model.
        soil: preset of the soil below a vehicle.
        base: of a robot.
    """
    config = of_target(word, soil=soil, base=base)
    document = load_target(config).document
    rows = []
    for keys, value in numbers_in(document):
        if UNLISTED & set(keys):
            continue
        is_one = is_number(value)
        rows.append(
            {
                "name": path_of(document, keys), "value": float(value) if is_one else 1.0, "low": None, "high": None,
                "identifiable": None, "kind": "value" if is_one else "factor",
            }
        )  # fmt: skip
    return rows


UNLISTED: Final = frozenset((
    "version", "robot", "hulls", "height_fields", "meshes", "sprocket_profiles", "flexible_meshes", "excluded_bodies",
    "excluded_shapes", "given_pairs", "parent", "child", "body", "asset", "group", "mask", "priority", "terms",
    "rotation", "steering_index", "axes", "velocity", "omega", "initial_q", "initial_qd",
))  # fmt: skip
"""Keys of a document that hold no parameters: indices, unit vectors, geometry, starts."""


def _digest(config: FitConfig, runs: Sequence[RunLog]) -> str:
    """Of all that a fit's course depends on; how many iterations are made is no part of it."""
    plain = dataclasses.replace(config, folder=".", search=dataclasses.replace(config.search, iterations=1))
    digest = hashlib.sha256(repr(plain).encode())
    for run in runs:
        for signals in (run.readings, run.inputs):
            for name, signal in signals.items():
                digest.update(name.encode())
                digest.update(signal.time.tobytes())
                digest.update(signal.value.tobytes())
    return digest.hexdigest()
