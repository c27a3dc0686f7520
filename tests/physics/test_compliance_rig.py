"""Compliance of bushings against the statics of a planar double wishbone with level arms."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from simwarp.core.rotation import matrix_of
from simwarp.vehicle.rigs import RowStatus, SuspensionReference, WheelForce, run_compliance_rig
from simwarp.vehicle.rigs.compliance_rig import _push
from simwarp.vehicle.rigs.standing_loads import standing_loads
from simwarp.vehicle.spec.vehicle_spec import Bushing, SpecError, VehicleSpec
from simwarp.vehicle.suspensions.kinematics import hold_axle
from tests.physics.sample_vehicles import shipped

STIFFNESS = 4.0e6
"""Of each bushing [N/m]."""
FORCE = 1000.0


def level_arms(bushing: Bushing | None) -> VehicleSpec:
    """The sedan with level arms across its rear axle above the contact points, the tie rod beside the lower one."""
    spec = shipped("sedan")
    axle = spec.axles[1]
    part: Any = axle.suspension
    low_in, low_out = part.lower_arm_front[1], part.lower_arm_upright[1]
    high_in, high_out = part.upper_arm_front[1], part.upper_arm_upright[1]
    low, high = part.lower_arm_upright[2], part.upper_arm_upright[2]
    made = dataclasses.replace(
        part, lower_arm_front=(0.2, low_in, low), lower_arm_back=(-0.2, low_in, low),
        lower_arm_upright=(0.0, low_out, low), upper_arm_front=(0.2, high_in, high),
        upper_arm_back=(-0.2, high_in, high), upper_arm_upright=(0.0, high_out, high),
        tierod_chassis=(-0.15, low_in, low), tierod_upright=(-0.15, low_out, low),
        spindle=dataclasses.replace(part.spindle, com=(0.0, *part.spindle.com[1:])),
        upper_arm_bushing=bushing, lower_arm_bushing=bushing,
    )  # fmt: skip
    return dataclasses.replace(spec, axles=(spec.axles[0], dataclasses.replace(axle, suspension=made)))


@pytest.mark.slow
def test_side_forces_lean_the_wheel_by_both_bushings():
    """F at the contact point is borne by both arms as by a lever: each bushing gives way by its part over its
    stiffness. The tie rod, beside, bears none. Springs press the arms' bushings down by a tenth of a degree: 1 % of
    the numbers.
    """
    soft = Bushing(
        stiffness_linear=STIFFNESS, damping_linear=1e4, stiffness_rotational=1e5, damping_rotational=100.0
    )  # fmt: skip
    spec = level_arms(soft)
    found = run_compliance_rig(
        spec, 1, WheelForce.SIDE, force=FORCE, points=3, reference=SuspensionReference.BUILT
    )  # fmt: skip
    assert (found.status == RowStatus.DONE).all()
    part: Any = spec.axles[1].suspension
    low, high, centre = part.lower_arm_upright[2], part.upper_arm_upright[2], part.spindle.com[2]
    contact = centre - float(standing_loads(spec).loaded_radius[1])
    upper, lower = FORCE * (contact - low) / (high - low), FORCE * (high - contact) / (high - low)
    lean = (upper - lower) / STIFFNESS / (high - low)  # of the top to the left
    slope = (found.camber[2] - found.camber[0]) / 2.0
    assert slope == pytest.approx([lean, -lean], rel=0.03)
    shift = (found.shift[2, :, 1] - found.shift[0, :, 1]) / 2.0
    wanted = lower / STIFFNESS + lean * (centre - low)
    assert shift == pytest.approx([wanted, wanted], rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(WheelForce))
def test_a_linkage_without_bushings_is_rigid(kind):
    """It is the same in all worlds, to the rounding of the closed loops."""
    found = run_compliance_rig(shipped("sedan"), 1, kind, force=2000.0, points=3)
    assert (found.status == RowStatus.DONE).all()
    assert np.ptp(found.camber, axis=0).max() < 1e-9
    assert np.ptp(found.steer, axis=0).max() < 1e-9
    assert found.parameters()[f"{kind.value}_camber_deg_per_kN"] == pytest.approx(0.0, abs=1e-6)


def test_brake_forces_act_at_the_lowest_points_of_leaning_wheels():
    """The lowest of 3600 points of the wheel's circle is the contact point to a radius times half a degree squared in
    height, and half a degree times the toe aside: 0.1 mm. Forces are float32.
    """
    spec, radius = shipped("sedan"), 0.3
    axle = spec.axles[1]
    leaning = dataclasses.replace(axle, suspension=dataclasses.replace(axle.suspension, camber=0.1, toe=0.02))
    held = hold_axle(dataclasses.replace(spec, axles=(spec.axles[0], leaning)), 1, [0.0, 0.0], [0.0, 0.0])
    forces = np.array([-FORCE, FORCE])
    _push(held, WheelForce.BRAKE, forces, radius)
    state, torque = held.simulation.state, held.simulation.control.body_torque.numpy()
    x, q = state.body_x.numpy(), state.body_rot.numpy()
    angle = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
    circle = radius * np.stack([np.cos(angle), 0.0 * angle, np.sin(angle)], axis=1)
    for side in held.bench.sides:
        points = x[0, side.spindle] + circle @ matrix_of(q[0, side.spindle]).T
        arm = points[points[:, 2].argmin()] - x[0, side.carrier]
        for world, force in enumerate(forces):
            wanted = np.cross(arm, (-force, 0.0, 0.0))
            assert torque[world, side.carrier] == pytest.approx(wanted, abs=1e-4 * FORCE)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"force": 0.0}, "force: must be > 0 N, got 0"), ({"points": 4}, "points: must be an odd number from 3 on")],
)
def test_an_empty_range_is_one_line(options, message):
    with pytest.raises(SpecError, match=message):
        run_compliance_rig(shipped("sedan"), 1, **options)
    with pytest.raises(SpecError, match="must have a suspension that travels"):
        run_compliance_rig(shipped("gator"), 1)
