"""Vehicles as FMUs for co-simulation (FMI 2.0), by `pythonfmu`: who imports one has Python with simwarp."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import json
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final

from simwarp.core.constraints import Meaning, Positive
from simwarp.core.files import layout, replacing, write_file
from simwarp.core.types import ModelError
from simwarp.model.rules import RULES
from simwarp.vehicle.driving.drivers import ScriptSpec
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.channels import Recorder
from simwarp.vehicle.results.runs import REFERENCE_DT, REFERENCE_FRICTION, Setup, set_up
from simwarp.vehicle.results.usual_columns import meaning_of, unit_of
from simwarp.vehicle.spec.drivetrain_parts import ManualShafts
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec, TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_files import to_json
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle

VEHICLE_FILE: Final = "vehicle.json"
INTERFACE_FILE: Final = "interface.json"
"""Of the resources: the vehicle, and the variables with the numbers behind them."""
CHANNELS: Final = ("Fx_*", "Fy_*")
"""Of the wheels, beside the usual columns."""
DRIVEN: Final = {"throttle", "brake", "steer", "t_s"}
"""Columns that are inputs."""
SCRIPT: Final = '''"""The vehicle of this FMU; what it does is in simwarp.exporters."""

from simwarp.exporters.fmu_slave import VehicleSlave, keep

keep(globals())


class {name}(VehicleSlave):
    pass
'''


@dataclasses.dataclass(frozen=True)
class FmuVariable:
    """A variable of an FMU.

    Attributes:
        name: of it.
        causality: input, output or parameter.
        unit: "" for none.
        description: what it is, with axes and signs.
        start: of inputs and parameters.
    """

    name: str
    causality: str
    unit: str
    description: str
    start: float = 0.0


@dataclasses.dataclass(frozen=True)
class FmuSetting:
    """Parameters of an FMU once they are set.

    Attributes:
        friction: of the ground.
        chassis_mass: of the chassis [kg].
        initial_speed: with which a vehicle on wheels begins [m/s].
        dt: time step of the physics [s].
    """

    friction: float = REFERENCE_FRICTION
    chassis_mass: float = 0.0
    initial_speed: float = 0.0
    dt: float = REFERENCE_DT


def is_manual(spec: AnyVehicleSpec) -> bool:
    """Whether the driver shifts, with a clutch."""
    return isinstance(spec.transmission, ManualShafts)


def chassis_mass(spec: AnyVehicleSpec) -> float:
    """Of all components of the chassis together [kg]."""
    return float(sum(part.mass for part in spec.chassis.components))


def undriven(spec: AnyVehicleSpec, setting: FmuSetting, device: str | None = "cpu") -> Setup[AnyVehicle]:
    """A vehicle at the start of its run that nobody drives: `vehicle.input` is there to be written.

    Args:
        spec: of the vehicle.
        setting: of the run; another mass scales the chassis' inertia with it.
        device: of the run.

    Raises:
        SpecError: a number cannot be used.
    """
    factor = setting.chassis_mass / chassis_mass(spec)
    driven = spec if factor == 1.0 else _heavier(spec, factor)
    maneuver = Maneuver(name="fmu", script=ScriptSpec(), start=0.0, duration=1.0, initial_speed=setting.initial_speed)
    return set_up(driven, maneuver, device=device, dt=setting.dt, friction=setting.friction, driven=False)


def _heavier(spec: AnyVehicleSpec, factor: float) -> AnyVehicleSpec:
    """Every component of the chassis by a factor."""
    parts = []
    for part in spec.chassis.components:
        (a, b, c), (d, e, f) = part.inertia, part.products
        inertia, products = (factor * a, factor * b, factor * c), (factor * d, factor * e, factor * f)
        parts.append(dataclasses.replace(part, mass=factor * part.mass, inertia=inertia, products=products))
    return dataclasses.replace(spec, chassis=dataclasses.replace(spec.chassis, components=tuple(parts)))


def fmu_variables(spec: AnyVehicleSpec, dt: float = REFERENCE_DT) -> list[FmuVariable]:
    """Inputs, parameters and outputs of a vehicle's FMU, outputs in the order of its columns.

    Args:
        spec: of the vehicle.
        dt: time step of the physics [s].
    """
    steer = "-1 to 1, positive to the left"
    found = [
        FmuVariable("steering", "input", "", f"steering, {steer}"),
        FmuVariable("throttle", "input", "", "throttle, 0 to 1"),
        FmuVariable("braking", "input", "", "brakes, 0 to 1"),
    ]
    if is_manual(spec):
        found += [
            FmuVariable("clutch", "input", "", "clutch, 0 (engaged) to 1"),
            FmuVariable("gear_lever", "input", "", "gear: -1 reverse, 0 neutral, 1 and up forward", 1.0),
        ]
    found += [
        FmuVariable("friction", "parameter", "", "friction of the ground", REFERENCE_FRICTION),
        FmuVariable("chassis_mass", "parameter", "kg", "mass of the chassis; its inertia follows", chassis_mass(spec)),
        FmuVariable("dt", "parameter", "s", "time step of the physics; communication steps are multiples of it", dt),
    ]
    if not isinstance(spec, TrackedVehicleSpec):
        meaning = "speed with which the vehicle begins, wheels rolling"
        found.append(FmuVariable("initial_speed", "parameter", "m/s", meaning))
    recorder = recorder_of(undriven(spec, FmuSetting(chassis_mass=chassis_mass(spec), dt=dt)))
    meanings = {each.name: each.meaning for each in recorder.channels}
    for name in recorder.names:
        if name not in DRIVEN:
            unit = unit_of(name)
            found.append(
                FmuVariable(name, "output", "" if unit == "1" else unit, meanings.get(name) or meaning_of(name))
            )
    return found


def recorder_of(setup: Setup[AnyVehicle]) -> Recorder:
    """What reads the outputs."""
    channels = () if isinstance(setup.vehicle.parts.spec, TrackedVehicleSpec) else CHANNELS
    return Recorder(setup.simulation, setup.vehicle, channels=channels)


@RULES.arguments("save_fmu")
def save_fmu(
    spec: AnyVehicleSpec, path: str | Path, *, dt: Annotated[Positive, Meaning("seconds")] = REFERENCE_DT
) -> None:  # fmt: skip
    """Writes a vehicle as an FMU for co-simulation, FMI 2.0, which holds its description.

    Who imports it needs Python with simwarp of this version; the first run on a machine compiles kernels. Inputs are
    those of a driver, outputs the usual columns and forces of the wheels, parameters the mass of the chassis, friction,
    time step and the speed at the start.

    Args:
        spec: of the vehicle.
        path: ends in .fmu; folders on the way are there.
        dt: time step of the physics [s], which the importing tool may change.

    Raises:
        ModelError: pythonfmu is not installed, or the name ends otherwise.
    """
    target = Path(path)
    if target.suffix != ".fmu":
        raise ModelError(f"save_fmu: path must end in .fmu, got '{path}'")
    try:
        from pythonfmu.builder import FmuBuilder
    except ModuleNotFoundError as error:
        raise ModelError(f"FMU: must have module '{error.name}', got none; pip install 'simwarp[fmu]'") from None
    name = "vehicle_" + re.sub(r"\W", "_", spec.name, flags=re.ASCII)
    variables = [dataclasses.asdict(each) for each in fmu_variables(spec, dt)]
    with tempfile.TemporaryDirectory(prefix="simwarp fmu ") as folder:
        script = Path(folder) / f"{name}.py"
        write_file(script, SCRIPT.format(name=name))
        write_file(Path(folder) / VEHICLE_FILE, to_json(spec))
        write_file(Path(folder) / INTERFACE_FILE, layout({"name": spec.name, "variables": variables}) + "\n")
        files = [Path(folder) / VEHICLE_FILE, Path(folder) / INTERFACE_FILE]
        with replacing(target) as unfinished, _imported_once(name):
            FmuBuilder.build_FMU(script, dest=unfinished, project_files=files)


@contextlib.contextmanager
def _imported_once(name: str) -> Iterator[None]:
    """For a script that pythonfmu imports from a folder that it adds to the path: both are taken back."""
    path = list(sys.path)
    importlib.invalidate_caches()
    try:
        yield
    finally:
        sys.path[:] = path
        sys.modules.pop(name, None)


def read_interface(resources: str | Path) -> tuple[str, list[FmuVariable]]:
    """Name of the vehicle and the variables in the resources of an FMU."""
    content = json.loads((Path(resources) / INTERFACE_FILE).read_text(encoding="utf-8"))
    return content["name"], [FmuVariable(**each) for each in content["variables"]]
