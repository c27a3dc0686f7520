"""A vehicle for every suspension template: two equal axles under a box, wheels and tires of the sedan, no engine.

Hardpoints of the MacPherson strut, the multi-link suspension, the solid and the pinned axle, and the trailing arm are
those of Project Chrono's generic vehicle (data/vehicle/generic and sedan); springs are chosen to carry this box.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import (
    AntirollBar,
    Bushing,
    Chassis,
    ForceLine,
    MacPhersonStrut,
    MultiLink,
    PinnedAxle,
    RigidPart,
    SolidAxle,
    SteeringMount,
    Suspension,
    TrailingArm,
    VehicleSpec,
)

SPINDLE = RigidPart(mass=1.103, com=(0.0, 0.8, 0.0), inertia=(0.000478, 0.000496, 0.000478))


def shipped(name: str) -> Any:
    """A shipped vehicle, of which the tests know what is in it."""
    return load_vehicle(name)


def macpherson_strut() -> MacPhersonStrut:
    top, bottom = (-0.115, 0.785, 0.579), (-0.07402507, 0.8532915, 0.2484536)
    return MacPhersonStrut(
        spindle=dataclasses.replace(SPINDLE, com=(-0.04000403, 1.1, -0.02602507)),
        upright=RigidPart(mass=20.0, com=(-0.04000015, 0.9099997, -0.0260268), inertia=(0.0138, 0.0146, 0.00283)),
        strut=RigidPart(mass=5.0, com=(-0.094512535, 0.81914575, 0.4137268), inertia=(0.01, 0.01, 0.005)),
        lower_arm=RigidPart(mass=5.091, com=(-0.031, 0.646, -0.156), inertia=(0.0269, 0.06058, 0.03377)),
        lower_arm_front=(0.22, 0.52, -0.156), lower_arm_back=(-0.3, 0.507, -0.137),
        lower_arm_upright=(-0.02165371, 0.940577, -0.1740283), strut_chassis=top, strut_upright=bottom,
        tierod_chassis=(-0.3, 0.52, -0.059), tierod_upright=(-0.2373756, 0.8949504, -0.01605418),
        springs=(
            ForceLine(chassis_point=top, arm_point=bottom, stiffness=60000.0, rest_length=0.41),
            ForceLine(chassis_point=top, arm_point=bottom, damping=4000.0),
        ),
        axle_inertia=0.4,
    )  # fmt: skip


def multi_link() -> MultiLink:
    return MultiLink(
        spindle=SPINDLE,
        upright=RigidPart(mass=3.201, com=(0.0, 0.76, 0.0), inertia=(0.025, 0.00653, 0.0284)),
        upper_arm=RigidPart(mass=4.744, com=(-0.014, 0.49, 0.098), inertia=(0.0237, 0.0294, 0.00612)),
        lateral=RigidPart(mass=1.91, com=(0.033, 0.44, -0.113), inertia=(0.0543, 0.0541, 0.000279)),
        trailing_link=RigidPart(mass=15.204, com=(0.279, 0.543, -0.132), inertia=(0.0762, 0.527, 0.567)),
        upper_arm_front=(0.06, 0.397, 0.082), upper_arm_back=(-0.157, 0.358, 0.062),
        upper_arm_upright=(0.056, 0.714, 0.151), lateral_chassis=(0.036, 0.188, -0.133),
        lateral_upright=(0.029, 0.692, -0.093), trailing_link_chassis=(0.723, 0.449, -0.072),
        trailing_link_upright=(0.0, 0.714, -0.156), tierod_chassis=(-0.257, 0.17, -0.116),
        tierod_upright=(-0.144, 0.712, -0.056),
        springs=(
            ForceLine(chassis_point=(0.181, 0.491, 0.11), arm_point=(0.181, 0.419, -0.164), stiffness=100000.0,
                      rest_length=0.326),
            ForceLine(chassis_point=(0.171, 0.478, 0.315), arm_point=(0.181, 0.519, -0.162), damping=8000.0),
        ),
        axle_inertia=0.166,
    )  # fmt: skip


def solid_axle(*, steered: bool = True) -> SolidAxle:
    return SolidAxle(
        spindle=dataclasses.replace(SPINDLE, com=(0.0, 0.91, 0.0)),
        knuckle=RigidPart(mass=1.356, com=(0.0, 0.7, 0.0), inertia=(0.00255, 0.00134, 0.00196)),
        axle_tube=RigidPart(mass=44.958, inertia=(7.744, 0.045, 7.744)),
        upper_link=RigidPart(mass=1.446, com=(0.15, 0.4875, 0.15), inertia=(0.011, 0.011, 0.000142)),
        lower_link=RigidPart(mass=2.892, com=(0.23, 0.475, -0.06), inertia=(0.0514, 0.0514, 0.00037)),
        knuckle_lower=(0.005, 0.7, -0.05), knuckle_upper=(-0.015, 0.675, 0.075),
        upper_link_chassis=(0.355, 0.5, 0.15), upper_link_axle=(-0.055, 0.475, 0.15),
        lower_link_chassis=(0.45, 0.35, -0.045), lower_link_axle=(0.01, 0.6, -0.075),
        tierod_knuckle=(-0.075, 0.68, -0.065),
        draglink_chassis=(-0.16, -0.4, -0.02) if steered else None,
        draglink_knuckle=(-0.15, 0.66, -0.03) if steered else None,
        springs=(
            ForceLine(chassis_point=(-0.08, 0.56, 0.3), arm_point=(-0.065, 0.575, -0.025), stiffness=100000.0,
                      rest_length=0.37),
            ForceLine(chassis_point=(-0.08, 0.56, 0.3), arm_point=(-0.065, 0.575, -0.025), damping=6000.0),
        ),
        axle_inertia=0.4,
    )  # fmt: skip


def pinned_axle() -> PinnedAxle:
    return PinnedAxle(
        spindle=SPINDLE, axle_tube=RigidPart(mass=10.0, inertia=(0.006, 0.003, 0.006)), pin=(0.0, 0.0, 0.15),
        axle_inertia=0.4,
    )  # fmt: skip


def trailing_arm() -> TrailingArm:
    return TrailingArm(
        spindle=SPINDLE, arm=RigidPart(mass=2.0, com=(0.3, 0.6, 0.0), inertia=(0.006, 0.002, 0.007)),
        pivot=(0.46, 0.55, -0.025), pivot_axis=(0.257, 0.953, 0.159), axle_inertia=0.4,
        springs=(
            ForceLine(chassis_point=(0.2, 0.6, 0.4), arm_point=(0.2, 0.6, 0.0), stiffness=120000.0, rest_length=0.44),
            ForceLine(chassis_point=(0.2, 0.6, 0.5), arm_point=(0.2, 0.6, 0.0), damping=8000.0),
        ),
    )  # fmt: skip


def vehicle(front: Suspension, rear: Suspension, *, height: float = 0.36, steered: bool = True) -> VehicleSpec:
    """A box of 1200 kg on two axles; a rack holds the front tie rods where `steered`."""
    sedan = shipped("sedan")
    like = sedan.axles[0]
    axles = tuple(
        dataclasses.replace(
            like, location=(x, 0.0, 0.0), suspension=suspension, steering=0 if steered and x > 0.0 else None
        )
        for x, suspension in ((1.4, front), (-1.4, rear))
    )
    box = RigidPart(mass=1200.0, com=(0.0, 0.0, 0.3), inertia=(250.0, 900.0, 1000.0))
    return VehicleSpec(
        name="sample", chassis=Chassis(components=(box,)), axles=axles,
        steerings=(SteeringMount(steering=sedan.steerings[0].steering, location=(1.1, 0.0, -0.06)),) if steered else (),
        start_height=height,
    )  # fmt: skip


def with_antiroll_bars(spec: VehicleSpec, stiffness: float = 10000.0) -> VehicleSpec:
    """The same with a bar on each axle, before and below it."""
    return dataclasses.replace(
        spec,
        axles=tuple(
            dataclasses.replace(
                axle,
                antiroll_bar=AntirollBar(
                    location=(axle.location[0] - 0.45, 0.0, axle.location[2] - 0.1), arm_mass=1.0,
                    arm_inertia=(0.03, 0.005, 0.03), arm_length=0.65, arm_width=0.4, droplink_height=-0.08,
                    stiffness=stiffness, damping=100.0,
                ),
            )
            for axle in spec.axles
        ),
    )  # fmt: skip


def with_bushings(spec: VehicleSpec) -> VehicleSpec:
    """The same vehicle with double wishbones whose arms are held by rubber."""
    rubber = Bushing(stiffness_linear=7.0e7, damping_linear=3.5e4, stiffness_rotational=1.0e5, damping_rotational=500.0)
    axles: list[Any] = list(spec.axles)
    changed = [
        dataclasses.replace(
            axle,
            suspension=dataclasses.replace(axle.suspension, upper_arm_bushing=rubber, lower_arm_bushing=rubber),
        )
        for axle in axles
    ]
    return dataclasses.replace(spec, axles=tuple(changed))


def samples() -> dict[str, VehicleSpec]:
    """A vehicle for each template, and for the parts that an axle may have besides."""
    sedan = shipped("sedan")
    return {
        "macpherson-strut": vehicle(macpherson_strut(), macpherson_strut()),
        "multi-link": vehicle(multi_link(), multi_link()),
        "solid-axle": vehicle(solid_axle(), solid_axle(steered=False)),
        "pinned-axle": vehicle(macpherson_strut(), pinned_axle()),
        "trailing-arm": vehicle(macpherson_strut(), trailing_arm()),
        "antiroll-bar": with_antiroll_bars(sedan),
        "bushings": with_bushings(shipped("hmmwv")),
    }


LINES_OF_A_SIDE = {"sedan": (1, 1), "hmmwv": (2, 2), "macpherson-strut": (0, 0), "multi-link": (2, 2)}
"""Spring elements that remain of the descriptions' lines: front, rear."""
