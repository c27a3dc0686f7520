"""Channels of what moves wheels and steering: torques of the driveline, angle and torque of the steering wheel."""

from __future__ import annotations

import math
from functools import partial
from typing import Final

import numpy as np

from simwarp.core.rotation import matrix_of
from simwarp.core.types import JointType
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.results.channel_samples import Array, Channel, Sample, wheel_names_of
from simwarp.vehicle.results.chassis_motion import matrices
from simwarp.vehicle.suspensions.steerings import HANDWHEEL
from simwarp.vehicle.vehicle import Vehicle

FULL_TURN: Final = math.radians(HANDWHEEL)
"""Of the steering wheel at full input [rad]."""


def effort_channels(simulation: Simulation, vehicle: Vehicle) -> list[Channel]:
    """Torque of the driveline on every wheel that it drives; angle of the steering wheel and the torque that holds it.

    The torques are read from reactions of joints.
    """
    names = wheel_names_of(vehicle.parts.spec)
    found = [
        Channel(
            f"torque_{names[wheel]}_Nm", "N·m", "of the driveline on the wheel about its axle, positive forwards",
            partial(along_axis, simulation=simulation, joint=vehicle.parts.sides[wheel].turn), True,
        )
        for wheel in driven_wheels(simulation, vehicle)
    ]  # fmt: skip
    if not vehicle.parts.steerings:
        return found

    first = vehicle.parts.steerings[0]
    column = simulation.model.joint_dof_start[first.joint]

    def angle(s: Sample) -> Array:
        return np.asarray(s.of(simulation.state.joint_q)[:, column] * (FULL_TURN / first.travel))

    def torque(s: Sample) -> Array:
        # by virtual work: the steering's coordinate moves by its travel where the wheel turns by FULL_TURN
        parts = (along_axis(s, simulation, each.joint) * each.travel for each in vehicle.parts.steerings)
        return np.asarray(sum(parts, np.zeros(1)) / FULL_TURN)

    meaning = f"turn of the steering wheel where the steering stands, {HANDWHEEL:g}° at its end, positive to the left"
    held = "that holds and moves the steering, at the steering wheel without assistance, positive to the left"
    return [
        *found, Channel("steeringwheel_rad", "rad", meaning, angle),
        Channel("steeringwheel_Nm", "N·m", held, torque, True),
    ]  # fmt: skip


def driven_wheels(simulation: Simulation, vehicle: Vehicle) -> list[int]:
    """Numbers of the wheels on which a driveline acts."""
    starts, line = simulation.model.joint_dof_start, vehicle.parts.driveline
    coupled = {dof for coupling in simulation.model.builder.couplings for dof, _ in coupling.terms}
    split = {joint for left, right, *_ in line.split for joint in (left, right)}
    return [
        wheel
        for wheel, side in enumerate(vehicle.parts.sides)
        if side.turn in split or starts[side.turn] in coupled
    ]  # fmt: skip


def along_axis(s: Sample, simulation: Simulation, joint: int) -> Array:
    """(n,) torque, of a slide the force, of a joint on its second body along its axis [N·m or N]: of a prescribed
    motion what moves it.
    """
    spec, diagnostics = simulation.model.builder.joints[joint], simulation.diagnostics
    body = matrices(s.of(simulation.state.body_rot)[:, spec.child])
    axis = body @ matrix_of(np.asarray(spec.frame1.rotation, float))[:, 2]
    slides = spec.type is JointType.PRISMATIC
    reaction = diagnostics.joint_reaction_force if slides else diagnostics.joint_reaction_torque
    return np.einsum("wi,wi->w", s.of(reaction)[:, joint], axis)
