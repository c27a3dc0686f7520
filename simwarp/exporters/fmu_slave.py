"""The vehicle in an FMU: what `pythonfmu` calls on the machine that imports it."""

from __future__ import annotations

import ctypes
import gc
import math
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
from pythonfmu.enums import Fmi2Initial, Fmi2Status

from simwarp.core.types import WorldStatus
from simwarp.exporters.vehicle_fmu import (
    VEHICLE_FILE,
    FmuSetting,
    FmuVariable,
    is_manual,
    read_interface,
    recorder_of,
    undriven,
)
from simwarp.vehicle.tracks.tracked_files import load_any_vehicle

BASE_UNITS = {
    "s": {"s": 1}, "m": {"m": 1}, "kg": {"kg": 1}, "rad": {"rad": 1}, "m/s": {"m": 1, "s": -1},
    "m/s²": {"m": 1, "s": -2}, "rad/s": {"rad": 1, "s": -1}, "rad/s²": {"rad": 1, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2}, "N·m": {"kg": 1, "m": 2, "s": -2}, "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
}  # fmt: skip
"""Exponents of SI units in the units of variables."""


def keep(names: dict[str, Any]) -> None:
    """One more reference to the names of an FMU's script, which nobody gives back.

    The library of pythonfmu 0.7 looks for the class among them, and gives back one reference more than it took: without
    this the names of a script without functions are freed while they are in use.
    """
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(names))


class VehicleSlave(Fmi2Slave):
    """A vehicle on level ground, driven by the inputs of the importing tool."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        script = sys.modules.get(type(self).__module__)
        if script is not None:
            keep(vars(script))  # of the next instance
        name, self._variables = read_interface(self.resources)
        self.description = f"vehicle '{name}' of simwarp {version('simwarp')}; it needs Python with simwarp"
        self.author = "simwarp"
        self.version = version("simwarp")
        self._value = {each.name: each.start for each in self._variables}
        for each in self._variables:
            self._register(each)

    def _register(self, variable: FmuVariable) -> None:
        name = variable.name
        given: dict[str, Any] = {"causality": Fmi2Causality[variable.causality], "description": variable.description}
        if variable.causality == "parameter":
            given |= {"variability": Fmi2Variability.fixed, "initial": Fmi2Initial.exact}
        if variable.causality != "output":
            given["setter"] = lambda value: self._value.__setitem__(name, float(value))
        self.register_variable(Real(name, getter=lambda: self._value[name], **given))

    def to_xml(self, model_options: dict[str, str] | None = None) -> Element:
        """The model's description, with the units of its variables."""
        root = super().to_xml(model_options or {})
        units = {each.name: each.unit for each in self._variables if each.unit}
        for scalar in root.iter("ScalarVariable"):
            unit = units.get(scalar.get("name", ""))
            real = scalar.find("Real")
            if unit is not None and real is not None:
                real.set("unit", unit)
        definitions = Element("UnitDefinitions")
        for unit in sorted(set(units.values())):
            base = BASE_UNITS.get(unit)
            place = SubElement(definitions, "Unit", {"name": unit})
            if base is not None:
                SubElement(place, "BaseUnit", {key: str(power) for key, power in base.items()})
        root.insert([child.tag for child in root].index("CoSimulation") + 1, definitions)
        structure = root.find("ModelStructure")
        if structure is not None:
            first = SubElement(structure, "InitialUnknowns")
            for number, each in enumerate(self._variables, start=1):
                if each.causality == "output":
                    SubElement(first, "Unknown", {"index": str(number)})
        return root

    def exit_initialization_mode(self) -> None:
        """Builds the vehicle by the parameters that were set."""
        self._vehicle_spec = load_any_vehicle(Path(self.resources) / VEHICLE_FILE)
        names = ("friction", "chassis_mass", "initial_speed", "dt")
        self._setting = FmuSetting(**{name: self._value[name] for name in names if name in self._value})
        self._setup = undriven(self._vehicle_spec, self._setting)
        self._recorder = recorder_of(self._setup)
        self._read()

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Steps the vehicle under the inputs that were set.

        Returns:
            False where the step is no multiple of `dt`, or the vehicle has broken down.
        """
        dt = self._setting.dt
        steps = round(step_size / dt)
        if steps < 1 or not math.isclose(steps * dt, step_size, rel_tol=1e-6):
            rule = f"must be a multiple of dt = {dt:g} s, got {step_size:g} s; set the parameter dt"
            self.log(f"communication step: {rule}", Fmi2Status.error)
            return False
        self._write()
        self._setup.simulation.step(steps)
        self._read()
        if not self._setup.simulation.state.world_status.numpy()[0] & WorldStatus.NON_FINITE:
            return True
        self.log(f"the vehicle broke down before t = {current_time + step_size:g} s", Fmi2Status.error)
        return False

    def terminate(self) -> None:
        """Lets the simulation go, as long as its libraries are there: tools may never free the instance."""
        del self._setup, self._recorder
        gc.collect()

    def _write(self) -> None:
        """The inputs, as a driver writes them."""
        vehicle = self._setup.vehicle
        inputs = np.zeros(vehicle.input.shape, np.float32)
        names = ("steering", "throttle", "braking", "clutch")
        for place, name in enumerate(names[: inputs.shape[-1]]):
            low = -1.0 if name == "steering" else 0.0
            inputs[0, place] = min(max(self._value.get(name, 0.0), low), 1.0)
        vehicle.input.assign(inputs)
        if is_manual(self._vehicle_spec):
            vehicle.gear.fill_(round(self._value["gear_lever"]))

    def _read(self) -> None:
        """The outputs of the present state."""
        self._recorder.sample()
        row = self._recorder.rows.pop()[0]
        found = zip(self._recorder.names, row.tolist(), strict=True)
        self._value.update({name: value for name, value in found if name in self._value})
