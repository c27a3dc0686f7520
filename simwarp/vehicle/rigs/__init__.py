"""Virtual rigs: tires on a tire machine, suspensions and steerings on a bench, vehicles on posts and a tilt table.

    spec = sw.vehicle.load("hmmwv")
    curves = sw.vehicle.rigs.run_suspension_rig(spec, axle=0)

Every rig takes a description and returns arrays, whose units stand in their classes; a sweep is one batch of worlds.
"""

from simwarp.vehicle.rigs.compliance_rig import ComplianceCurve, WheelForce, run_compliance_rig
from simwarp.vehicle.rigs.four_post import (
    FourPostResponse,
    PostMode,
    RoadResponse,
    RoadSweep,
    SineSweep,
    run_four_post,
    run_four_post_roads,
)
from simwarp.vehicle.rigs.rig_rows import RigRows, RowStatus
from simwarp.vehicle.rigs.steering_rig import SteeringCurve, run_steering_rig
from simwarp.vehicle.rigs.suspension_curves import (
    SuspensionCurve,
    SuspensionMotion,
    SuspensionReference,
    SuspensionRun,
)
from simwarp.vehicle.rigs.suspension_rig import run_suspension_rig
from simwarp.vehicle.rigs.tilt_table import TiltTable, run_tilt_table
from simwarp.vehicle.rigs.tire_rig import TireCurves, TireForces, TireSweep, run_tire_rig, tire_forces
from simwarp.vehicle.roads.road_profiles import RoadClass, RoadProfile, displacement_spectrum, road_profile

__all__ = [
    "ComplianceCurve",
    "FourPostResponse",
    "PostMode",
    "RigRows",
    "RoadClass",
    "RoadProfile",
    "RoadResponse",
    "RoadSweep",
    "RowStatus",
    "SineSweep",
    "SteeringCurve",
    "SuspensionCurve",
    "SuspensionMotion",
    "SuspensionReference",
    "SuspensionRun",
    "TiltTable",
    "TireCurves",
    "TireForces",
    "TireSweep",
    "WheelForce",
    "displacement_spectrum",
    "road_profile",
    "run_compliance_rig",
    "run_four_post",
    "run_four_post_roads",
    "run_steering_rig",
    "run_suspension_rig",
    "run_tilt_table",
    "run_tire_rig",
    "tire_forces",
]
