"""Vehicles: descriptions, assembly into a model, tires, tracks, powertrain, drivers, recorded runs.

spec = sw.vehicle.load("hmmwv")
builder = sw.ModelBuilder()
parts = sw.vehicle.add_vehicle(builder, spec)
"""

from __future__ import annotations

from simwarp.vehicle.assessment.verdict import Verdict
from simwarp.vehicle.assessment.verdicts import verdicts
from simwarp.vehicle.construction import VehicleParts, add_chassis_box, add_vehicle
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
    "travel_table",
    "trim",
    "twist_gains_for",
    "unicycle_for",
    "vehicle_names",
    "verdicts",
    "with_belts",
    "with_options",
]
