"""Tires that are rigid wheels on deformable soil (`simwarp.soil.Soil`), which makes their forces."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import Any

import warp as wp

from simwarp.core.arrays import writable_from
from simwarp.model.model import Model
from simwarp.simulation.attachments import StepContext
from simwarp.vehicle.spec.parts import SPECS
from simwarp.vehicle.spec.vehicle_parts import Tire
from simwarp.vehicle.tires.ground_kernels import TerrainTables
from simwarp.vehicle.tires.tire_parameters import SoilRigidParameters
from simwarp.vehicle.tires.wheel_reports import WheelReports, parameter_text

TEMPLATE = "soil-rigid"


def soil_rigid_parameters(tire: Tire) -> SoilRigidParameters:
    """What the description of such a tire says beside its radius and width.

    Raises:
        SpecError: another key, or a value that breaks a rule.
    """
    values: SoilRigidParameters = SPECS.load(SoilRigidParameters, tire.parameters, parameter_text)
    return values


class SoilTires(WheelReports):
    """The wheels of a vehicle on soil: the outputs of `Tires`, written by the `Soil` that the wheels are given to.

    Args:
        count: of the wheels, in the order of the reports.
        model: of the vehicle.
        terrain: the undeformed ground, for the soil; None: the plane z = 0.

    Attributes:
        load: (W, wheels) vertical force [N].
        deflection: (W, wheels) depth of the soil below each wheel's centre [m].
        slip_ratio: (W, wheels), positive when driving.
        force_w, torque_w: (W, wheels) vec3 on each wheel at its centre, world axes [N, N·m].
        slip_angle, camber, state: zeros; soil does not report them.
        ground_friction: (1,) of no effect: the soil's own strength counts.
    """

    def __init__(self, count: int, model: Model, terrain: TerrainTables | None = None) -> None:
        super().__init__(count, model)
        self.terrain = terrain
        self.ground_friction = writable_from([1.0], wp.float32, model.device)

    def show(self, soil: Any, first: int) -> None:
        """From now on report what a soil finds of its wheels from number `first` on."""
        self.show_soil(soil, first)

    def missing_ground(self, simulation: StepContext, own: Container[int]) -> str:
        """Return what is missing for the wheels to stand on, in words; empty if nothing is.

        Args:
            simulation: of the vehicle.
            own: of no effect: soil is no shape.
        """
        if any(hasattr(element, "sinkage") for element in simulation.elements):
            return ""
        return "the Simulation has no Soil; give it elements=[vehicle, soil_under(vehicle)]"

    def record(self, simulation: StepContext) -> Sequence[Any]:
        """Nothing comes before a sub-step: the soil records its own launches."""
        return []

    def record_after(self, simulation: StepContext) -> Sequence[Any]:
        """Nothing comes after one."""
        return []
