"""Motors of robots by the numbers of their data sheets: each is an `ActuatorSpec`."""

from __future__ import annotations

import math
from typing import Any

from simwarp.actuators.actuator_spec import ActuatorSpec, Law
from simwarp.core.types import FLOAT32_MAX, ModelError, formatted, number
from simwarp.model.checks import checked_name, finite_number, not_negative, positive_number


def pd_actuator(
    name: str, dof: int, *, stiffness: float, damping: float, effort_limit: float = math.inf, delay: float = 0.0,
    target_range: tuple[float, float] | None = None,
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
    thing = checked_name("actuator", name)
    k = not_negative(thing, "stiffness", stiffness, "N·m/rad or N/m")
    d = not_negative(thing, "damping", damping, "N·m·s/rad or N·s/m")
    return ActuatorSpec(
        name=name, terms=((dof, 1.0),), gain=(k, 0.0, 0.0), bias=(0.0, -k, -d),
        force_range=_both_ways(thing, effort_limit), delay=not_negative(thing, "delay", delay, "s"),
        ctrl_range=target_range,
    )  # fmt: skip


def dc_motor(
    name: str, dof: int, *, stall_torque: float, free_speed: float, corner_speed: float = 0.0, stiffness: float = 0.0,
    damping: float = 0.0, effort_limit: float = math.inf, delay: float = 0.0,
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
    thing = checked_name("actuator", name)
    k = not_negative(thing, "stiffness", stiffness, "N·m/rad or N/m")
    d = not_negative(thing, "damping", damping, "N·m·s/rad or N·s/m")
    has_gains = k > 0.0 or d > 0.0
    return ActuatorSpec(
        name=name, terms=((dof, 1.0),), gain=(k if has_gains else 1.0, 0.0, 0.0), bias=(0.0, -k, -d),
        force_range=_both_ways(thing, effort_limit), delay=not_negative(thing, "delay", delay, "s"),
        ctrl_range=target_range,
        torque_speed=(
            positive_number(thing, "stall_torque", stall_torque, "N·m or N", "pd_actuator has no curve"),
            positive_number(thing, "free_speed", free_speed, "rad/s or m/s", "pd_actuator has no curve"),
        ),
        corner_speed=not_negative(thing, "corner_speed", corner_speed, "rad/s or m/s"),
    )  # fmt: skip


def torque_actuator(name: str, dof: int, *, effort_limit: float = math.inf, delay: float = 0.0) -> ActuatorSpec:
    """An ideal motor whose control is its torque: tau = u, within a limit.

    Args:
        name: of the control.
        dof: column of `State.joint_q`, as `model.dof(joint)` gives it.
        effort_limit: largest torque or force either way [N·m or N].
        delay: of the control [s], rounded to whole sub-steps.

    Raises:
        ModelError: a number is not usable.
    """
    thing = checked_name("actuator", name)
    limit = _both_ways(thing, effort_limit)
    return ActuatorSpec(
        name=name, terms=((dof, 1.0),), force_range=limit, delay=not_negative(thing, "delay", delay, "s"),
    )  # fmt: skip


def servo_actuator(
    name: str, dof: int, *, delay: float = 0.0, target_range: tuple[float, float] | None = None
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
    thing = checked_name("actuator", name)
    return ActuatorSpec(
        name=name, terms=((dof, 1.0),), law=Law.SERVO, delay=not_negative(thing, "delay", delay, "s"),
        ctrl_range=target_range,
    )  # fmt: skip


def _both_ways(thing: str, limit: Any) -> tuple[float, float] | None:
    """Bounds of a force from its largest size; None where it is infinite."""
    given = number(limit)
    if given == math.inf or given > FLOAT32_MAX:
        return None
    if not given > 0.0:
        raise ModelError(f"{thing}: effort_limit must be > 0, got {formatted(limit)}; leave it out for no limit")
    size = finite_number(thing, "effort_limit", limit)
    return -size, size
