"""Vehicles: descriptions, assembly into a model, tires, tracks, powertrain, drivers, recorded runs.

spec = sw.vehicle.load("hmmwv")
builder = sw.ModelBuilder()
parts = sw.vehicle.add_vehicle(builder, spec)

Names are imported on first use: few commands need all of them, and kernels take a while to import.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from simwarp.core.names_on_demand import names_on_demand

if TYPE_CHECKING:
    from simwarp.vehicle.assessment.verdict import Verdict
    from simwarp.vehicle.assessment.verdicts import verdicts
    from simwarp.vehicle.construction import VehicleParts, add_chassis_box, add_vehicle, trailer_boxes
    from simwarp.vehicle.driving.drivers import ScriptedDriver, ScriptSpec
    from simwarp.vehicle.driving.maneuver_spec import FrictionPatch, Maneuver
    from simwarp.vehicle.driving.maneuvers import maneuver
    from simwarp.vehicle.driving.path_tracking import (
        InteractiveDriver,
        LookAhead,
        PathTracker,
        PathTrackingSpec,
        Stanley,
        Unicycle,
        look_ahead_for,
        unicycle_for,
    )
    from simwarp.vehicle.driving.paths import Path, bezier, circle, read_path
    from simwarp.vehicle.driving.twist import SteeredVehicle, TwistDriver, TwistGains, twist_gains_for
    from simwarp.vehicle.payload import PAYLOAD, Payload, add_payload, set_payload
    from simwarp.vehicle.placing import place_vehicle
    from simwarp.vehicle.reduced.reduced_wheels import ReducedWheels
    from simwarp.vehicle.reduced.reduction import reduce_vehicle
    from simwarp.vehicle.results.chain_record import ChainProfile, ChainRecord
    from simwarp.vehicle.results.channels import Recorder, Run
    from simwarp.vehicle.results.runs import Drive, set_up
    from simwarp.vehicle.spec.belt_parts import BeltLaw, BeltTrack, belt_of
    from simwarp.vehicle.spec.parts import SpecError
    from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec, with_belts
    from simwarp.vehicle.spec.variants import option_names, with_options
    from simwarp.vehicle.spec.vehicle_files import load_vehicle, reduced_vehicle_names, save_vehicle, vehicle_names
    from simwarp.vehicle.spec.vehicle_spec import Tire, VehicleSpec
    from simwarp.vehicle.stances import AxleStance, LineStance, Stance, stance
    from simwarp.vehicle.suspensions.kinematics import TravelTable, spring_lengths, travel_table
    from simwarp.vehicle.tires.parameter_vector_kernels import Common as CommonTire, Tmeasy as TmeasyTire
    from simwarp.vehicle.tires.tires import Tires, ground, ground_of
    from simwarp.vehicle.tracks.belt_construction import BeltTrackParts
    from simwarp.vehicle.tracks.belt_tables_kernels import BeltParameter
    from simwarp.vehicle.tracks.belts import Belts
    from simwarp.vehicle.tracks.shoe_construction import ShoeTrackParts, SprocketContact
    from simwarp.vehicle.tracks.tracked_construction import TrackedVehicleParts, add_tracked_vehicle
    from simwarp.vehicle.tracks.tracked_files import (
        all_vehicle_names,
        load_any_vehicle,
        load_tracked_vehicle,
        save_tracked_vehicle,
        tracked_vehicle_names,
    )
    from simwarp.vehicle.tracks.tracked_vehicle import TRACK_SOLVER, TrackedVehicle
    from simwarp.vehicle.trimming import trim
    from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, Vehicles, per_world
    from simwarp.vehicle.vehicle_convoy import Convoy, set_up_convoy

    load = load_vehicle
    """`sw.vehicle.load(name_or_file)`: the same as `load_vehicle`."""

__all__ = [
    "PAYLOAD",
    "TRACK_SOLVER",
    "VEHICLE_SOLVER",
    "AxleStance",
    "BeltLaw",
    "BeltParameter",
    "BeltTrack",
    "BeltTrackParts",
    "Belts",
    "ChainProfile",
    "ChainRecord",
    "CommonTire",
    "Convoy",
    "Drive",
    "FrictionPatch",
    "InteractiveDriver",
    "LineStance",
    "LookAhead",
    "Maneuver",
    "Path",
    "PathTracker",
    "PathTrackingSpec",
    "Payload",
    "Recorder",
    "ReducedWheels",
    "Run",
    "ScriptSpec",
    "ScriptedDriver",
    "ShoeTrackParts",
    "SpecError",
    "SprocketContact",
    "Stance",
    "Stanley",
    "SteeredVehicle",
    "Tire",
    "Tires",
    "TmeasyTire",
    "TrackedVehicle",
    "TrackedVehicleParts",
    "TrackedVehicleSpec",
    "TravelTable",
    "TwistDriver",
    "TwistGains",
    "Unicycle",
    "Vehicle",
    "VehicleParts",
    "VehicleSpec",
    "Vehicles",
    "Verdict",
    "add_chassis_box",
    "add_payload",
    "add_tracked_vehicle",
    "add_vehicle",
    "all_vehicle_names",
    "belt_of",
    "bezier",
    "circle",
    "ground",
    "ground_of",
    "load",
    "load_any_vehicle",
    "load_tracked_vehicle",
    "load_vehicle",
    "look_ahead_for",
    "maneuver",
    "option_names",
    "per_world",
    "place_vehicle",
    "read_path",
    "reduce_vehicle",
    "reduced_vehicle_names",
    "save_tracked_vehicle",
    "save_vehicle",
    "set_payload",
    "set_up",
    "set_up_convoy",
    "spring_lengths",
    "stance",
    "tracked_vehicle_names",
    "trailer_boxes",
    "travel_table",
    "trim",
    "twist_gains_for",
    "unicycle_for",
    "vehicle_names",
    "verdicts",
    "with_belts",
    "with_options",
]

_MODULES: Final = {
    "PAYLOAD": "payload", "TRACK_SOLVER": "tracks.tracked_vehicle", "VEHICLE_SOLVER": "vehicle",
    "AxleStance": "stances", "BeltLaw": "spec.belt_parts", "BeltParameter": "tracks.belt_tables_kernels",
    "BeltTrack": "spec.belt_parts", "BeltTrackParts": "tracks.belt_construction", "Belts": "tracks.belts",
    "ChainProfile": "results.chain_record", "ChainRecord": "results.chain_record",
    "CommonTire": "tires.parameter_vector_kernels:Common", "Convoy": "vehicle_convoy", "Drive": "results.runs",
    "FrictionPatch": "driving.maneuver_spec", "InteractiveDriver": "driving.path_tracking", "LineStance": "stances",
    "LookAhead": "driving.path_tracking", "Maneuver": "driving.maneuver_spec", "Path": "driving.paths",
    "PathTracker": "driving.path_tracking", "PathTrackingSpec": "driving.path_tracking", "Payload": "payload",
    "Recorder": "results.channels", "ReducedWheels": "reduced.reduced_wheels", "Run": "results.channels",
    "ScriptSpec": "driving.drivers", "ScriptedDriver": "driving.drivers", "ShoeTrackParts": "tracks.shoe_construction",
    "SpecError": "spec.parts", "SprocketContact": "tracks.shoe_construction", "Stance": "stances",
    "Stanley": "driving.path_tracking", "SteeredVehicle": "driving.twist", "Tire": "spec.vehicle_spec",
    "Tires": "tires.tires", "TmeasyTire": "tires.parameter_vector_kernels:Tmeasy",
    "TrackedVehicle": "tracks.tracked_vehicle", "TrackedVehicleParts": "tracks.tracked_construction",
    "TrackedVehicleSpec": "spec.tracked_vehicle_spec", "TravelTable": "suspensions.kinematics",
    "TwistDriver": "driving.twist", "TwistGains": "driving.twist", "Unicycle": "driving.path_tracking",
    "Vehicle": "vehicle", "VehicleParts": "construction", "VehicleSpec": "spec.vehicle_spec", "Vehicles": "vehicle",
    "Verdict": "assessment.verdict", "add_chassis_box": "construction", "add_payload": "payload",
    "add_tracked_vehicle": "tracks.tracked_construction", "add_vehicle": "construction",
    "all_vehicle_names": "tracks.tracked_files", "belt_of": "spec.belt_parts", "bezier": "driving.paths",
    "circle": "driving.paths", "ground": "tires.tires", "ground_of": "tires.tires",
    "load": "spec.vehicle_files:load_vehicle", "load_any_vehicle": "tracks.tracked_files",
    "load_tracked_vehicle": "tracks.tracked_files", "load_vehicle": "spec.vehicle_files",
    "look_ahead_for": "driving.path_tracking", "maneuver": "driving.maneuvers", "option_names": "spec.variants",
    "per_world": "vehicle", "place_vehicle": "placing", "read_path": "driving.paths",
    "reduce_vehicle": "reduced.reduction", "reduced_vehicle_names": "spec.vehicle_files",
    "save_tracked_vehicle": "tracks.tracked_files", "save_vehicle": "spec.vehicle_files", "set_payload": "payload",
    "set_up": "results.runs", "set_up_convoy": "vehicle_convoy", "spring_lengths": "suspensions.kinematics",
    "stance": "stances", "tracked_vehicle_names": "tracks.tracked_files", "trailer_boxes": "construction",
    "travel_table": "suspensions.kinematics", "trim": "trimming",
    "twist_gains_for": "driving.twist", "unicycle_for": "driving.path_tracking",
    "vehicle_names": "spec.vehicle_files", "verdicts": "assessment.verdicts",
    "with_belts": "spec.tracked_vehicle_spec", "with_options": "spec.variants",
}  # fmt: skip

__getattr__ = names_on_demand(__name__, _MODULES)
