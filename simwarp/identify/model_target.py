"""A robot or any other model whose numbers are fitted: worlds differ in what its file says, and efforts drive them."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from simwarp.core import files
from simwarp.core.schema import Place
from simwarp.core.types import WORLD, ModelError, WorldStatus, formatted
from simwarp.core.wording import shortened, suggestions
from simwarp.identify.fit_config import FitConfig
from simwarp.identify.fit_error import FitError
from simwarp.identify.world_numbers import InputRows, World, WorldNumbers, model_numbers, write_world_numbers
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import Model
from simwarp.model.model_files import builder_of, model_text
from simwarp.model.model_format import FORMAT, MODELS, ModelEntry
from simwarp.model.parameters import PARAMETERS
from simwarp.simulation.simulation import Simulation

Array = npt.NDArray[np.float64]

SHIFT: Final = "com_shift"
"""Of a body in the document: how far its centre of mass is from where its file has it, body axes [m]."""
AXES: Final = ("x", "y", "z")
QUATERNION: Final = ("x", "y", "z", "w")
JOINT_READINGS: Final = ("joint_position", "joint_velocity", "joint_acceleration")
BODY_READINGS: Final = ("body_position", "body_rotation", "body_velocity", "body_rate")
INPUTS: Final = {
    "joint_force": "joint_force", "joint_target": "joint_target_q", "joint_target_rate": "joint_target_qd",
}  # fmt: skip
"""Beginning of an input's name -> array of `Control`."""
STARTING: Final = ("joint_position", "joint_velocity", *BODY_READINGS)
"""Readings that tell the state."""
READERS: Final = {".xml": "load_mjcf", ".urdf": "load_urdf", ".usd": "load_usd", ".usda": "load_usd"}
"""Of `simwarp.importers`, by the ending of a file."""


class ModelTarget:
    """A model from a file of `sw.save_model` or `simwarp import --save`, or a robot's MJCF, URDF or USD file.

    Args:
        config: of the fit.
        device: of its simulations.
        threads: of a CPU; None: all.
        builder: of the model; None: it is loaded.

    Attributes:
        name: of the file.
        document: as model files have it, with a `com_shift` of every body.
        usual_warmup: none.
    """

    usual_warmup = 0.0

    def __init__(
        self, config: FitConfig, device: str | None = None, threads: int | None = None,
        builder: ModelBuilder | None = None,
    ) -> None:  # fmt: skip
        self.name = Path(config.target).stem
        self._dt, self._every, self._device, self._threads = config.dt, config.sample_steps, device, threads
        self._place = Place(shortened(self.name), ModelError)
        found = _builder(config) if builder is None else builder
        self.document: Any = json.loads(model_text(found))
        for body in self.document["bodies"]:
            body[SHIFT] = [0.0, 0.0, 0.0]
        self._base = self._build(self.document)
        self._model: Model = self._base.finalize(world_count=1, device="cpu")

    # ---- numbers -----------------------------------------------------------------------------------------------------

    def _build(self, document: Any) -> ModelBuilder:
        entry: ModelEntry = MODELS.load(ModelEntry, _with_shifted_centres(document), self._place.line)
        return builder_of(entry, self._place)

    def numbers(self, document: Any, start: Mapping[str, float]) -> WorldNumbers:
        """The numbers of a world with another document."""
        found = model_numbers(self._build(document), self._base)
        shifts = np.array([body[SHIFT] for body in document["bodies"]], float).reshape(-1, 3)
        return WorldNumbers(found.parameters, found.state, {"shift": shifts})

    def model_names(self) -> Model:
        """A model of one world, for the names of its parts."""
        return self._model

    def saved(self, document: Any) -> Any:
        """The model's file, its centres of mass where they were found."""
        return _with_shifted_centres(document)

    # ---- readings ----------------------------------------------------------------------------------------------------

    def can_start_with(self, name: str) -> bool:
        """Readings that tell the state."""
        if name.partition(":")[0] not in STARTING:
            return False
        self.place_of(name)
        return True

    def measured_start(self, readings: Sequence[str]) -> Sequence[str]:
        """Those that tell the state."""
        return [name for name in readings if name.partition(":")[0] in STARTING]

    def check_names(self, readings: Sequence[str], inputs: Sequence[str]) -> None:
        """Refuse readings and inputs that the model does not have."""
        for name in readings:
            self.place_of(name)
        for name in inputs:
            kind, _, joint = name.partition(":")
            if kind not in INPUTS:
                known = [f"{each}:NAME" for each in INPUTS]
                raise FitError(f"inputs: {formatted(name)}: no input of a model; inputs: {', '.join(known)}")
            self.column(name, joint)

    def place_of(self, name: str) -> tuple[str, int, int]:
        """Kind of a reading, index of its body or of its coordinate, and which component.

        Raises:
            FitError: there is none of that name.
        """
        kind, _, part = name.partition(":")
        if kind in JOINT_READINGS:
            return kind, self.column(name, part), 0
        if kind not in BODY_READINGS:
            known = (*JOINT_READINGS, *BODY_READINGS)
            hint = suggestions(kind, known, f"readings: {', '.join(known)}")
            raise FitError(f"readings: {formatted(name)}: no reading of a model; {hint}")
        body, _, axis = part.rpartition(".")
        axes = QUATERNION if kind == "body_rotation" else AXES
        if body not in self._model.body_names or axis not in axes:
            wanted = f"{kind}:BODY.{axes[0]} to .{axes[-1]}"
            hint = suggestions(body, self._model.body_names, f"bodies: {', '.join(self._model.body_names[:12])}")
            raise FitError(f"readings: {formatted(name)}: must be {wanted}; {hint}")
        return kind, self._model.body_names.index(body), axes.index(axis)

    def column(self, name: str, joint: str) -> int:
        """The column of a joint's coordinate; `NAME.1` is the second one of a joint that has several."""
        names = self._model.joint_names
        word, _, local = joint.rpartition(".")
        if joint in names:
            word, local = joint, "0"
        starts = self._model.joint_dof_start
        if word in names and local.isdigit():
            index = names.index(word)
            if int(local) < starts[index + 1] - starts[index]:
                return starts[index] + int(local)
        hint = suggestions(joint, names, f"joints: {', '.join(names[:12])}")
        raise FitError(f"{formatted(name)}: there is no coordinate {formatted(joint)}; {hint}")

    def rollout(self, worlds: int, differing: set[str], readings: Sequence[str], inputs: Sequence[str]) -> ModelRollout:
        """A simulation of so many worlds."""
        names = {name for name in differing if name in PARAMETERS}
        model = self._build(self.document).finalize(world_count=worlds, device=self._device, per_world=names)
        accelerations = any(name.startswith("joint_acceleration") for name in readings)
        simulation = Simulation(model, self._dt, threads=self._threads, joint_accelerations=accelerations)
        return ModelRollout(self, simulation, names, readings, inputs, self._every)


class ModelRollout:
    """Worlds with a model each.

    Args:
        target: the model.
        simulation: of the worlds.
        differing: parameters in which they differ.
        readings, inputs: names of what is read and written.
        every: steps between readings.
    """

    def __init__(
        self, target: ModelTarget, simulation: Simulation, differing: set[str], readings: Sequence[str],
        inputs: Sequence[str], every: int,
    ) -> None:  # fmt: skip
        self._target, self.simulation, self._differing, self._every = target, simulation, differing, every
        self._places = [target.place_of(name) for name in readings]
        self._inputs: list[tuple[str, list[int], list[int]]] = []
        for kind, array in INPUTS.items():
            own = [(index, name) for index, name in enumerate(inputs) if name.partition(":")[0] == kind]
            if own:
                columns = [target.column(name, name.partition(":")[2]) for _, name in own]
                self._inputs.append((array, columns, [index for index, _ in own]))

    def run(self, worlds: Sequence[World], samples: int) -> Array:
        """(samples + 1, W, readings); nan from where a world broke down on."""
        simulation = self.simulation
        rows = [*worlds, *[worlds[-1]] * (simulation.model.world_count - len(worlds))]
        simulation.reset(sensors=False)
        write_world_numbers(simulation, self._differing, worlds)
        self._shifts = np.stack([world.numbers.others["shift"] for world in rows])
        self._start(rows)
        if simulation.diagnostics.joint_qdd.size:
            simulation.diagnostics.joint_qdd.zero_()  # that of a run before
        inputs = np.stack([world.inputs for world in rows])
        written = [InputRows(getattr(simulation.control, array)) for array, _, _ in self._inputs]
        record = np.empty((samples + 1, len(rows), len(self._places)))
        record[0] = self._read()
        for sample in range(1, samples + 1):
            for step in range((sample - 1) * self._every, sample * self._every):
                for to_write, (_, columns, own) in zip(written, self._inputs, strict=True):
                    with np.errstate(over="ignore"):  # such worlds diverge, and are counted
                        to_write.values[:, columns] = inputs[:, step, own]
                    to_write.publish()
                simulation.step()
            record[sample] = self._read()
        return record[:, : len(worlds)]

    def _start(self, rows: Sequence[World]) -> None:
        """Put the worlds to their starts."""
        simulation, target = self.simulation, self._target
        simulation.measure(sensors=False)
        state = simulation.state
        arrays = {
            name: getattr(state, name).numpy().copy()
            for name in ("joint_q", "joint_qd", "body_x", "body_rot", "body_v", "body_omega")
        }
        names = {
            "joint_position": "joint_q", "joint_velocity": "joint_qd", "body_position": "body_x",
            "body_rotation": "body_rot", "body_velocity": "body_v", "body_rate": "body_omega",
        }  # fmt: skip
        turned: set[int] = set()
        moved: set[int] = set()
        for world, row in enumerate(rows):
            for name, value in row.start.items():
                kind, index, axis = target.place_of(name)
                array = arrays[names[kind]]
                if kind.startswith("joint"):
                    array[world, index] = value
                else:
                    array[world, index, axis] = value
                    (turned if kind == "body_rotation" else moved).add(index)
        for body in turned | moved:
            arrays["body_rot"][:, body] /= np.linalg.norm(arrays["body_rot"][:, body], axis=1)[:, None]
            arm = Rotation.from_quat(arrays["body_rot"][:, body]).apply(self._shifts[:, body])
            arrays["body_x"][:, body] += arm
            arrays["body_v"][:, body] += np.cross(arrays["body_omega"][:, body], arm)
        for name in ("body_x", "body_rot", "body_v", "body_omega"):
            getattr(state, name).assign(arrays[name])
        simulation.set_joint_state(None, arrays["joint_q"], arrays["joint_qd"])

    def _read(self) -> Array:
        """(W, readings) of the present state."""
        state = self.simulation.state
        fetched: dict[str, Array] = {}

        def of(name: str, array: Any) -> Array:
            if name not in fetched:
                fetched[name] = array.numpy().astype(float)
            return fetched[name]

        def arm(body: int) -> Array:
            return np.asarray(Rotation.from_quat(of("rot", state.body_rot)[:, body]).apply(self._shifts[:, body]))

        def upright(body: int) -> Array:
            q = of("rot", state.body_rot)[:, body]
            return np.asarray(np.where(q[:, 3:] < 0.0, -q, q))

        readers: dict[str, Callable[[int, int], Array]] = {
            "joint_position": lambda index, _: of("x", state.joint_x)[:, index],
            "joint_velocity": lambda index, _: of("qd", state.joint_qd)[:, index],
            "joint_acceleration": lambda index, _: of("qdd", self.simulation.diagnostics.joint_qdd)[:, index],
            "body_position": lambda body, axis: (of("bx", state.body_x)[:, body] - arm(body))[:, axis],
            "body_rotation": lambda body, axis: upright(body)[:, axis],
            "body_velocity": lambda body, axis: (
                of("v", state.body_v)[:, body] - np.cross(of("w", state.body_omega)[:, body], arm(body))
            )[:, axis],
            "body_rate": lambda body, axis: of("w", state.body_omega)[:, body, axis],
        }
        worlds = self.simulation.model.world_count
        found = np.empty((worlds, len(self._places)))
        for column, (kind, index, axis) in enumerate(self._places):
            found[:, column] = readers[kind](index, axis)
        found[state.world_status.numpy() & int(WorldStatus.NON_FINITE) != 0] = np.nan
        return found


def _with_shifted_centres(document: Any) -> Any:
    """A model file: what is fixed to a body whose centre of mass is elsewhere is placed from there."""
    made = copy.deepcopy(document)
    shifts = [np.array(body.pop(SHIFT, [0.0, 0.0, 0.0]), float) for body in made["bodies"]]
    if not np.any(shifts):
        return made
    for body, shift in zip(made["bodies"], shifts, strict=True):
        rotation = Rotation.from_quat(body.get("rotation", [0.0, 0.0, 0.0, 1.0]))
        body["position"] = (np.array(body.get("position", [0.0] * 3)) + rotation.apply(shift)).tolist()
    for joint in made.get("joints", []):
        for side, frame in (("parent", "frame0"), ("child", "frame1")):
            body = joint.get(side, WORLD)
            if body != WORLD and np.any(shifts[body]):
                held = joint.setdefault(frame, {})
                held["position"] = (np.array(held.get("position", [0.0] * 3)) - shifts[body]).tolist()
    for shape in made.get("shapes", []):
        body = shape.get("body", WORLD)
        if body != WORLD and np.any(shifts[body]):
            shape["position"] = (np.array(shape.get("position", [0.0] * 3)) - shifts[body]).tolist()
    return made


def is_model_file(path: Path) -> bool:
    """Whether a file is a robot's or a model's."""
    if path.suffix in READERS:
        return True
    if path.suffix != ".json":
        return False
    try:
        value = files.read_json(path, "model")
    except files.FileError:
        return False
    return isinstance(value, dict) and value.get("format") == FORMAT


def _builder(config: FitConfig) -> ModelBuilder:
    path = config.path_of(config.target)
    if path.suffix == ".json":
        from simwarp.model.model_files import load_model

        return load_model(path)
    from simwarp import importers

    given = {} if config.base is None or path.suffix != ".urdf" else {"base": config.base}
    loaded: ModelBuilder = getattr(importers, READERS[path.suffix])(path, **given).builder
    return loaded
