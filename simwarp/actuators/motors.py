"""Motors of robots by the numbers of their data sheets: each is an `ActuatorSpec`."""

from __future__ import annotations

import math
from typing import Annotated, TypeAlias

from simwarp.actuators.actuator_spec import ActuatorSpec, Delay, Law, OfCurve
from simwarp.core.constraints import Infinite, Meaning, Positive
from simwarp.core.types import FLOAT32_MAX
from simwarp.model.rules import RULES, Name, Passive

ForceLimit: TypeAlias = Annotated[Positive, Infinite(), Meaning("N·m or N; leave it out for no limit")]


@RULES.arguments("actuator '{name}'")
def pd_actuator(
    name: Name, dof: int, *, stiffness: Passive, damping: Passive, effort_limit: ForceLimit = math.inf,
    delay: Delay = 0.0, target_range: tuple[float, float] | None = None,
) -> ActuatorSpec:  # fmt: skip
    """A PD controller that computes its torque at the start of each sub-step: tau = k (u - q) - d qd, within a limit.

    The law is explicit, as that of a controller that runs at the rate of the sub-steps: it needs d h and k h² well
    below the joint's inertia. `PositionDrive` with `servo_actuator` is the same law taken implicitly, stable for any
    gains.

    Args:
        name: of the control.
        dof: column of `State.joint_q`, as `model.dof(joint)` gives it.
        stiffness: k [N·m/rad or N/m].
        damping: d [N·m·s/rad or N·s/m].
        effort_limit: largest torque or force either way [N·m or N].
        delay: of the target [s], rounded to whole sub-steps; before the first one has come through, it is 0.
        target_range: the target is clamped to it [rad or m]; None for no bounds.

    Raises:
        ModelError: a number is not usable.
    """
    return ActuatorSpec(
        name=name, terms=((dof, 1.0),), gain=(stiffness, 0.0, 0.0), bias=(0.0, -stiffness, -damping),
        force_range=_both_ways(effort_limit), delay=delay,
        ctrl_range=target_range,
    )  # fmt: skip


@RULES.arguments("actuator '{name}'")
def dc_motor(
    name: Name, dof: int, *, stall_torque: OfCurve, free_speed: OfCurve, corner_speed: Passive = 0.0,
    stiffness: Passive = 0.0, damping: Passive = 0.0, effort_limit: ForceLimit = math.inf, delay: Delay = 0.0,
    target_range: tuple[float, float] | None = None,
) -> ActuatorSpec:  # fmt: skip
    """A DC motor behind a PD controller, or without gains one whose control is the torque.

    What speeds the motion up is at most `stall_torque (1 - abs(qd) / free_speed)`, and nothing beyond the free speed;
    what brakes it is bounded by `effort_limit` alone. With a corner speed the stall torque is there up to it, and falls
    from there: the curve of a motor whose driver limits the current.

    Args:
        name: of the control: a target where there are gains, else a torque.
        dof: column of `State.joint_q`, as `model.dof(joint)` gives it.
        stall_torque: of the motor behind its gear at rest [N·m or N]; others call it saturation effort.
        free_speed: of the motor behind its gear without load [rad/s or m/s]; others call it velocity limit.
        corner_speed: up to which the whole stall torque is there [rad/s or m/s].
        stiffness: of the controller [N·m/rad or N/m].
        damping: of the controller [N·m·s/rad or N·s/m].
        effort_limit: largest torque or force either way, braking included [N·m or N].
        delay: of the control [s], rounded to whole sub-steps.
        target_range: the target is clamped to it [rad or m]; None for no bounds.

    Raises:
        ModelError: a number is not usable.
    """
    has_gains = stiffness > 0.0 or damping > 0.0
    return ActuatorSpec(
        name=name, terms=((dof, 1.0),), gain=(stiffness if has_gains else 1.0, 0.0, 0.0),
        bias=(0.0, -stiffness, -damping),
        force_range=_both_ways(effort_limit), delay=delay,
        ctrl_range=target_range,
        torque_speed=(stall_torque, free_speed), corner_speed=corner_speed,
    )  # fmt: skip


@RULES.arguments("actuator '{name}'")
def torque_actuator(name: Name, dof: int, *, effort_limit: ForceLimit = math.inf, delay: Delay = 0.0) -> ActuatorSpec:
    """An ideal motor whose control is its torque: tau = u, within a limit.

    Args:
        name: of the control.
        dof: column of `State.joint_q`, as `model.dof(joint)` gives it.
        effort_limit: largest torque or force either way [N·m or N].
        delay: of the control [s], rounded to whole sub-steps.

    Raises:
        ModelError: a number is not usable.
    """
    return ActuatorSpec(name=name, terms=((dof, 1.0),), force_range=_both_ways(effort_limit), delay=delay)


@RULES.arguments("actuator '{name}'")
def servo_actuator(
    name: Name, dof: int, *, delay: Delay = 0.0, target_range: tuple[float, float] | None = None
) -> ActuatorSpec:  # fmt: skip
    """The target of a joint that has a `PositionDrive`, late if wanted: the drive's law is implicit, its gains and its
    limit are the drive's.

    Args:
        name: of the control.
        dof: column of `State.joint_q`, as `model.dof(joint)` gives it.
        delay: of the target [s], rounded to whole sub-steps; before the first one has come through, it is 0.
        target_range: the target is clamped to it [rad or m]; None for no bounds.

    Raises:
        ModelError: a number is not usable.
    """
    return ActuatorSpec(
        name=name, terms=((dof, 1.0),), law=Law.SERVO, delay=delay,
        ctrl_range=target_range,
    )  # fmt: skip


def _both_ways(limit: float) -> tuple[float, float] | None:
    """Bounds of a force from its largest size; None where it is infinite."""
    return None if limit > FLOAT32_MAX else (-limit, limit)
