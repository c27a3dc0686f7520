"""A wheeled vehicle whose numbers are fitted: worlds differ in what its file says, and are driven by logged inputs."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import Material, WorldStatus, formatted
from simwarp.core.wording import suggestions
from simwarp.identify.document_numbers import replaced, scaled
from simwarp.identify.fit_config import FitConfig
from simwarp.identify.fit_error import FitError
from simwarp.identify.world_numbers import (
    InputRows,
    World,
    WorldNumbers,
    model_numbers,
    uniform_ratio,
    write_world_numbers,
)
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import Model
from simwarp.model.parameters import PARAMETERS
from simwarp.simulation.simulation import Simulation
from simwarp.soil import Soil, SoilSpec, soil_preset
from simwarp.soil.vehicle_wheels import soil_under
from simwarp.vehicle.construction import VehicleParts, add_vehicle
from simwarp.vehicle.driving.drawbar import MEASURED, Drawbar, with_locks
from simwarp.vehicle.reduced.reduced_wheels import rolling_speeds
from simwarp.vehicle.results.channels import COLUMNS, WheelReadings
from simwarp.vehicle.results.chassis_motion import ChassisMotion
from simwarp.vehicle.results.named_channels import NamedReadings, channels_of, wants_reactions
from simwarp.vehicle.spec.parts import SPECS
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import plain
from simwarp.vehicle.spec.vehicle_parts import Tire
from simwarp.vehicle.spec.vehicle_spec import EngineShafts, EngineSimple, VehicleSpec
from simwarp.vehicle.tires.parameter_vector import MODELS, TMEASY_PATTERNS, TMSIMPLE_PATTERNS, rated_values, tire_vector
from simwarp.vehicle.tires.tire_parameters import CommonParameters
from simwarp.vehicle.tires.tires import Tires
from simwarp.vehicle.tires.wheel_reports import REPORTED
from simwarp.vehicle.tracks.tracked_files import load_any_vehicle
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

Array = npt.NDArray[np.float64]

INPUTS: Final = ("steering", "throttle", "braking", "clutch")
"""Columns of `Vehicle.input`."""
HEADROOM: Final = 2.0
"""Factor of the engine in a batch whose worlds have different ones: inputs, which scale it, end at 1."""
POSE: Final = ("x_m", "y_m", "yaw_rad")
"""Readings that do not matter to how a vehicle goes on level ground: where it is, and its heading."""
SPEED: Final = "speed_mps"
STANDING: Final = 0.2
"""Measured speed below which a vehicle starts at rest [m/s]."""
GAINS: Final = ("steering", "throttle", "braking")
"""Inputs whose gain stands for a number of the vehicle that all worlds share: travel, engine, brakes."""


class VehicleTarget:
    """A vehicle on a road or on soil.

    Args:
        config: of the fit.
        device: of its simulations.
        threads: of a CPU; None: all.

    Attributes:
        name: of the vehicle.
        document: its file with `ground` or `soil` beside it.
        usual_warmup: [s].

    Raises:
        FitError: the vehicle runs on tracks.
    """

    usual_warmup = 1.0

    def __init__(self, config: FitConfig, device: str | None = None, threads: int | None = None) -> None:
        spec = load_any_vehicle(vehicle_word(config))
        if isinstance(spec, TrackedVehicleSpec):
            raise FitError(f"target: must be a vehicle on wheels, got {formatted(spec.name)} on tracks")
        self.name, self._dt, self._device, self._threads = spec.name, config.dt, device, threads
        if config.soil is not None:
            spec = with_options(spec, tire="soil-rigid")
        self._every = config.sample_steps
        self._drawbar = config.drawbar_test
        if self._drawbar is not None and spec.is_reduced:
            raise FitError(f"drawbar: must be of a vehicle with linkages, got the reduced {formatted(spec.name)}")
        self.document: Any = vehicle_document(spec)
        if config.soil is None:
            self.document["ground"] = {"friction": config.ground_friction}
        else:
            self.document["soil"] = dataclasses.asdict(soil_preset(config.soil))
        self._base = self._build(self.document, 0.0)

    # ---- numbers -----------------------------------------------------------------------------------------------------

    def _spec(self, document: Any) -> VehicleSpec:
        values = {key: value for key, value in document.items() if key not in ("ground", "soil")}
        made: VehicleSpec = SPECS.load(VehicleSpec, values)
        return made

    def _build(self, document: Any, speed: float) -> tuple[ModelBuilder, VehicleParts]:
        builder = ModelBuilder()
        spec = self._spec(document)
        parts = add_vehicle(builder, spec if self._drawbar is None else with_locks(spec), speed=speed)
        if any(side.meets_shapes for side in parts.sides) and "soil" not in document:
            builder.add_shape_plane(name="ground", material=Material(friction=document["ground"]["friction"]))
        return builder, parts

    def numbers(self, document: Any, start: Mapping[str, float]) -> WorldNumbers:
        """The numbers of a world with another document, that starts with a speed."""
        speed = start.get(SPEED, 0.0)
        # noise of a sensor is no rolling backwards, which would be in reverse gear
        builder, parts = self._build(document, speed if abs(speed) > STANDING else 0.0)
        found = vehicle_numbers(builder, parts, *self._base)
        gains = input_gains(parts, self._base[1])
        others: dict[str, npt.NDArray[Any]] = {**found.others, "gain": gains}
        if "soil" in document:
            others["soil"] = np.array(SoilSpec(**document["soil"]).values())
        else:
            others["friction"] = np.array([document["ground"]["friction"]])
        return dataclasses.replace(found, others=others)

    def model_names(self) -> Model:
        """A model of one world, for the names of its parts."""
        return self._base[0].finalize(world_count=1, device="cpu")

    def saved(self, document: Any) -> Any:
        """The vehicle's file."""
        return {key: value for key, value in document.items() if key not in ("ground", "soil")}

    # ---- readings ----------------------------------------------------------------------------------------------------

    def can_start_with(self, name: str) -> bool:
        """A vehicle starts straight ahead with a speed."""
        return name == SPEED

    def measured_start(self, readings: Sequence[str]) -> Sequence[str]:
        """The speed; pose and heading are laid over each other afterwards."""
        return [name for name in readings if name == SPEED]

    def check_names(self, readings: Sequence[str], inputs: Sequence[str]) -> None:
        """Refuse readings and inputs that a vehicle does not have."""
        for name in inputs:
            if name not in INPUTS:
                hint = suggestions(name, INPUTS, f"inputs: {', '.join(INPUTS)}")
                raise FitError(f"inputs: {formatted(name)}: no input of a vehicle; {hint}")
        rollout = VehicleRollout(self, 1, set(), (), ())
        known = (*rollout.usual_names, *(each.name for each in channels_of(rollout.simulation, rollout.vehicle)))
        for name in readings:
            if name not in known:
                hint = suggestions(name, known, "`simwarp drive VEHICLE --channels list` prints them")
                raise FitError(f"readings: {formatted(name)}: no reading of a vehicle; {hint}")

    def rollout(
        self, worlds: int, differing: set[str], readings: Sequence[str], inputs: Sequence[str]
    ) -> VehicleRollout:
        """A simulation of so many worlds.

        Raises:
            FitError: in a drawbar test worlds differ in what acts by the driver's inputs, which the test writes.
        """
        if self._drawbar is not None and "gain" in differing:
            raise FitError("parameters: engine, brakes and steering cannot be fitted to a drawbar test; leave them out")
        return VehicleRollout(self, worlds, differing, readings, inputs)


class VehicleRollout:
    """Worlds with a vehicle each.

    Args:
        target: the vehicle.
        worlds: number of them.
        differing: parameters and others in which they differ.
        readings, inputs: names of the channels that are read and written.
    """

    def __init__(
        self, target: VehicleTarget, worlds: int, differing: set[str], readings: Sequence[str], inputs: Sequence[str]
    ) -> None:  # fmt: skip
        document = target.document
        self._headroom = HEADROOM if "gain" in differing and _can_double(document) else 1.0
        if self._headroom != 1.0:
            document = _doubled(document)
        builder, parts = target._build(document, 0.0)
        self._differing = {name for name in differing if name in PARAMETERS}
        model = builder.finalize(
            world_count=worlds, device=target._device, per_world=per_world(self._differing)
        )  # fmt: skip
        self.vehicle = Vehicle(parts, model, randomised=True)
        elements: list[Any] = [self.vehicle]
        self.pulled: Mapping[str, Any] = {}
        """(W,) arrays that a drawbar test measures, by their reading."""
        if target._drawbar is not None:
            drawbar = Drawbar(self.vehicle, target._drawbar)
            elements.append(drawbar)
            # the weight is that of the vehicle as it is: worlds of other masses have another share of it
            self.pulled = {name: array for name, array in drawbar.measured.items() if name != MEASURED["share"]}
        self.soil: Soil | None = None
        if "soil" in document:
            self.soil = soil_under(self.vehicle, SoilSpec(**document["soil"]), per_world=True)
            elements.append(self.soil)
        self.simulation = Simulation(
            model, target._dt, elements=elements, solver=VEHICLE_SOLVER, threads=target._threads,
            joint_reactions=wants_reactions(readings),
        )  # fmt: skip
        self._every, self._worlds = target._every, worlds
        self._columns = [INPUTS.index(name) for name in inputs]
        self._gained = [GAINS.index(name) if name in GAINS else -1 for name in inputs]
        self._readings = tuple(readings)
        self._reference = np.tile(np.asarray(parts.reference, float), (worlds, 1))

    @property
    def usual_names(self) -> tuple[str, ...]:
        """Names of the readings that are not channels by name."""
        columns = (*COLUMNS[1:], *WheelReadings(self.simulation, self.vehicle).names[len(COLUMNS) :])
        return (*columns, *self.pulled)

    def run(self, worlds: Sequence[World], samples: int) -> Array:
        """(samples + 1, W, readings); nan from where a world broke down on."""
        simulation, vehicle = self.simulation, self.vehicle
        rows = [*worlds, *[worlds[-1]] * (self._worlds - len(worlds))]
        others = [world.numbers.others for world in rows]
        simulation.reset(sensors=False)
        write_world_numbers(simulation, self._differing, worlds)
        self._write_others(others)
        self._forget()
        simulation.measure()
        self._reference = np.stack([each["reference"] for each in others])
        inputs = self._scaled(rows)
        wheels = WheelReadings(simulation, vehicle)
        usual = self.usual_names
        named = NamedReadings(simulation, vehicle, [n for n in self._readings if n not in usual], usual)
        record = np.empty((samples + 1, self._worlds, len(self._readings)))
        record[0] = self._read(wheels, named)
        rows_of_inputs = InputRows(vehicle.input_rows)
        written = rows_of_inputs.values[:, 0]
        for sample in range(1, samples + 1):
            for step in range((sample - 1) * self._every, sample * self._every):
                if self._columns:
                    written[:, self._columns] = inputs[:, step]
                    rows_of_inputs.publish()
                simulation.step()
            record[sample] = self._read(wheels, named)
        return record[:, : len(worlds)]

    def _forget(self) -> None:
        """Let no reading at the start be that of a run before: what only a step computes is zero until then."""
        tires, vehicle, diagnostics = self.vehicle.tires, self.vehicle, self.simulation.diagnostics
        for array in (
            *(getattr(tires, name) for name in REPORTED), *self.pulled.values(), vehicle.engine_torque,
            vehicle.drive_torque,
            diagnostics.joint_reaction_force, diagnostics.joint_reaction_torque,
        ):  # fmt: skip
            if array.size:
                array.zero_()

    def _write_others(self, others: Sequence[Mapping[str, npt.NDArray[Any]]]) -> None:
        """Tires, soil, road and powertrain."""
        write_vehicle_numbers(self.vehicle, others)
        if self.soil is not None:
            self.soil.parameter.assign(np.stack([each["soil"] for each in others])[:, None])

    def _scaled(self, rows: Sequence[World]) -> Array:
        """(W, steps, inputs) as the vehicle takes them, with the gains of each world."""
        inputs = np.stack([world.inputs for world in rows])
        gains = np.stack([world.numbers.others["gain"] for world in rows])
        for column, gained in enumerate(self._gained):
            if gained >= 0:
                inputs[:, :, column] *= gains[:, gained, None]
            if gained == GAINS.index("throttle"):
                inputs[:, :, column] /= self._headroom
        return inputs

    def _read(self, wheels: WheelReadings, named: NamedReadings) -> Array:
        """(W, readings) of the present state."""
        every = slice(0, self._worlds)
        motion = ChassisMotion.of(self.simulation, self.vehicle, every)
        # each world's own frame of reference: its centre of mass may be elsewhere in it
        arm = np.einsum("wij,wj->wi", motion.rotation, self._reference)
        speed = np.einsum("wi,wi->w", motion.velocity + np.cross(motion.omega, arm), motion.rotation[:, :, 0])
        motion = dataclasses.replace(motion, position=motion.center + arm, speed=speed)
        found = {**motion.columns(), **wheels.read(motion, every), **named.read(motion, every)}
        found |= {name: array.numpy().astype(float) for name, array in self.pulled.items()}
        values = (
            np.stack([found[name] for name in self._readings], axis=1) if self._readings else np.zeros((len(arm), 0))
        )
        broken = self.simulation.state.world_status.numpy() & int(WorldStatus.NON_FINITE) != 0
        values[broken] = np.nan
        return np.asarray(values)


# ---- parts -----------------------------------------------------------------------------------------------------------


def vehicle_word(config: FitConfig) -> str:
    """The target as vehicles are loaded: a name, or a path from the folder of the configuration."""
    return str(config.path_of(config.target)) if config.target.endswith(".json") else config.target


def vehicle_document(spec: VehicleSpec) -> Any:
    """The file of a vehicle as dictionaries and lists, with all numbers of its tires, so that each has a path."""
    document = _plain_lists(plain(spec))
    for axle, entry in zip(spec.axles, document["axles"], strict=True):
        entry["tire"]["parameters"] = _explicit(axle.tire)
    return document


def vehicle_numbers(
    builder: ModelBuilder, parts: VehicleParts, base_builder: ModelBuilder, base: VehicleParts
) -> WorldNumbers:
    """The numbers of a world with another vehicle than that of its batch; `input_gains` has the rest.

    Args:
        builder, parts: of the world.
        base_builder, base: of the batch.

    Raises:
        FitError: a table differs by more than a factor.
    """
    found = model_numbers(builder, base_builder)
    rolling = parts.start
    others: dict[str, npt.NDArray[Any]] = {
        "reference": np.asarray(parts.reference, float),
        "rolling": np.array([rolling.gear, rolling.motor_speed, rolling.drive_speed]),
    }
    if parts.spec.axles[0].tire.template in MODELS:
        others["tires"] = _tire_rows(parts)
    if parts.spec.is_reduced:
        others["wheels"] = rolling_speeds(parts.spec, rolling)
    return dataclasses.replace(found, others=others)


def input_gains(parts: VehicleParts, base: VehicleParts) -> Array:
    """(3,) factors of steering, throttle and braking that stand for numbers which all worlds of a batch share.

    Args:
        parts: of a world.
        base: of its batch.

    Raises:
        FitError: something else differs that they share.
    """
    steering = _factor([each.travel for each in base.steerings], [each.travel for each in parts.steerings])
    torque = [
        [axle.brake.max_torque for axle in each.spec.all_axles if axle.brake is not None] for each in (base, parts)
    ]
    braking = _factor(*torque)
    throttle = _engine_factor(base.spec.engine, parts.spec.engine)
    for what, before, after in (
        ("steerings: their travels", steering, None), ("brakes: their torques", braking, None),
        ("engine", throttle, None), ("driveline", base.driveline, parts.driveline),
        ("transmission", (base.gears, base.spec.transmission), (parts.gears, parts.spec.transmission)),
        ("chassis: its drag", _drag(base.spec), _drag(parts.spec)),
    ):  # fmt: skip
        if before is None or (after is not None and before != after):
            raise FitError(f"{what}: all worlds share it, so that it cannot be fitted but for one common factor")
    return np.array([steering, throttle, braking])


def write_vehicle_numbers(vehicle: Vehicle, others: Sequence[Mapping[str, npt.NDArray[Any]]]) -> None:
    """Write tires, road and powertrain of every world.

    Args:
        vehicle: with numbers of its own for the tires of every world (`randomised`).
        others: of each world.
    """
    if isinstance(vehicle.tires, Tires):
        vehicle.tires.parameter.assign(np.stack([each["tires"] for each in others]))
        vehicle.tires.ground_friction.assign(np.concatenate([each["friction"] for each in others]))
    if vehicle.reduced is not None:
        vehicle.reduced.roll(np.stack([each["wheels"] for each in others]))
    rolling = np.stack([each["rolling"] for each in others])
    for name, values in (
        ("gear", rolling[:, 0]), ("engine_speed", np.abs(rolling[:, 1])), ("last_input", rolling[:, 1]),
        ("last_drive", rolling[:, 2]),
    ):  # fmt: skip
        if name in vehicle.memory:
            array = vehicle.memory[name]
            array.assign(values.reshape(array.shape).astype(array.numpy().dtype))


def _plain_lists(value: Any) -> Any:
    """Dictionaries and lists all the way down."""
    if isinstance(value, Mapping):
        return {key: _plain_lists(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain_lists(item) for item in value]
    return value


def _explicit(tire: Tire) -> dict[str, Any]:
    """Parameters of a tire with what its pattern stands for, so that each can be fitted."""
    given = dict(_plain_lists(tire.parameters))
    patterns = {"tmeasy": TMEASY_PATTERNS, "tmsimple": TMSIMPLE_PATTERNS}.get(tire.template)
    if patterns is None or "pattern" not in given:
        return given
    rated, curve = MODELS[tire.template].parts
    parts = []
    for kind in (rated, curve):
        own = {field.name for field in dataclasses.fields(kind)}
        parts.append(SPECS.load(kind, {key: value for key, value in given.items() if key in own}))
    common = {field.name for field in dataclasses.fields(CommonParameters)}
    values: Any = rated_values(tire, parts[0], parts[1], patterns)
    written = {key: value for key, value in given.items() if key in common} | _plain_lists(values)
    written.pop("pattern", None)
    same = tire_vector(dataclasses.replace(tire, parameters=written)).values
    return written if np.array_equal(same, tire_vector(tire).values) else given


def _tire_rows(parts: VehicleParts) -> Array:
    """(wheels, entries) parameter vectors."""
    vectors = [tire_vector(axle.tire).values for axle in parts.spec.all_axles]
    rows = np.zeros((len(parts.sides), max(map(len, vectors))))
    for row, side in zip(rows, parts.sides, strict=True):
        row[: len(vectors[side.axle])] = vectors[side.axle]
    return rows


def _factor(before: Sequence[float], after: Sequence[float]) -> float | None:
    """The one factor between some numbers; 1 of none, None where there is none."""
    if list(before) == list(after):
        return 1.0
    try:
        return uniform_ratio(np.array(before), np.array(after), True, "")
    except FitError:
        return None


def _engine_factor(before: Any, after: Any) -> float | None:
    """The factor between two engines whose torque goes with the throttle; None where it is more than a factor."""
    if before == after:
        return 1.0
    match before, after:
        case EngineShafts(), EngineShafts():
            factor = _factor([y for _, y in before.torque], [y for _, y in after.torque])
            same = dataclasses.replace(after, torque=before.torque) == before
        case EngineSimple(), EngineSimple():
            pairs = [(each.max_torque, each.max_power) for each in (before, after)]
            factor = _factor(*pairs)
            same = dataclasses.replace(after, max_torque=before.max_torque, max_power=before.max_power) == before
        case _:
            return None
    return factor if same else None


def _drag(spec: VehicleSpec) -> float:
    chassis = spec.chassis
    return chassis.air_density * chassis.drag_coefficient * chassis.drag_area


def _can_double(document: Any) -> bool:
    """Whether the engine's torque goes with the throttle, so that twice the torque at half the throttle is the same."""
    engine = document.get("engine") or {}
    return engine.get("template") in ENGINES


def _doubled(document: Any) -> Any:
    """The vehicle with the engine of the headroom."""
    keys = ENGINES[document["engine"]["template"]]
    return replaced(
        document, {("engine", key): scaled(document["engine"][key], HEADROOM) for key in keys}
    )  # fmt: skip


ENGINES: Final = {EngineShafts.template: ("torque",), EngineSimple.template: ("max_torque", "max_power")}
