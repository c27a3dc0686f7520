"""Actuators as data: what they pull on and their law; and motors of robots by the numbers of their data sheets."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Sequence
from typing import Annotated, Any, TypeAlias

import numpy as np

from simwarp.core.constraints import Infinite, Meaning, NotNegative, Parsed, Positive, RuleError
from simwarp.core.object_repr import ReadableFields
from simwarp.core.types import FLOAT32_MAX, Pose, number, numbers, pose as make_pose
from simwarp.model.rules import RULES, Name, Passive, Range, Signed, one_of, vector


class Activation(enum.IntEnum):
    """State between the control and the force."""

    NONE = 0
    """The force follows the control at once."""
    INTEGRATOR = 1
    """da/dt = ctrl."""
    FILTER = 2
    """da/dt = (ctrl - a) / time_constant, explicit Euler."""
    FILTER_EXACT = 3
    """The same, integrated exactly over a step."""


class Law(enum.IntEnum):
    """How the force reaches the joints."""

    EFFORT = 0
    """force = gain x control + bias, both affine in length and rate, taken at the start of a step."""
    SERVO = 1
    """The coordinate's `PositionDrive` follows the control; stiffness and damping are implicit."""


class Target(enum.IntEnum):
    """What a servo holds."""

    POSITION = 0
    """The coordinate: the control moves `Control.joint_target_q`; `joint_target_qd` is left to whoever writes it."""
    VELOCITY = 1
    """Its rate: the control moves `Control.joint_target_qd`, of a drive without stiffness."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SitePull:
    """Transmission to a frame: a wrench along fixed directions, on the body at the frame's origin.

    Attributes:
        body: that carries the frame; `WORLD` only with a reference.
        pose: of the frame, from the body's centre of mass, in body axes [m].
        gear: (6,) force [N] and torque [N·m] per unit of actuator force, in the frame's axes.
        reference: body of a frame in whose axes `gear` is given instead; it takes the reaction, at the same point. The
            length is then `gear` times place and rotation vector of the frame in the reference, and the rate that of
            the two against each other. None: axes of the frame's own, no reaction, length 0.
        reference_pose: of that frame, from the centre of mass of `reference` (world axes for `WORLD`).
    """

    body: int
    pose: Pose = dataclasses.field(default_factory=make_pose)
    gear: tuple[float, float, float, float, float, float] = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    reference: int | None = None
    reference_pose: Pose = dataclasses.field(default_factory=make_pose)


def _terms(value: Any) -> Any:
    listed = isinstance(value, Sequence) and not isinstance(value, str)
    for term in value if listed else (value,):
        column = term[0] if numbers(term).shape == (2,) else None
        if isinstance(column, bool) or not isinstance(column, (int, np.integer)) or not math.isfinite(number(term[1])):
            raise RuleError("(column, coefficient) pairs", "take model.dof(name)")
    return value


Coefficients: TypeAlias = Annotated[tuple[float, float, float], vector(3)]
Delay: TypeAlias = Annotated[NotNegative, Meaning("seconds, 0 for none")]
OfCurve: TypeAlias = Annotated[Positive, Meaning("a number of the motor's curve, or leave the curve out for no limit")]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ActuatorSpec(ReadableFields):
    """One actuator: force f = (g0 + g1 l + g2 l') u + b0 + b1 l + b2 l' along its length l, where u is its control or
    its activation. The joints of `terms` feel coefficient x f.

    Attributes:
        name: of the control.
        terms: (column of `State.joint_q`, coefficient): l = length_offset + sum of coefficient x q. Empty for a site.
        site: transmission to a frame in place of coordinates; its length is 0, its rate that of the frame along `gear`,
            unless it has a reference.
        length_offset: length where all coordinates are 0.
        law: EFFORT, or SERVO along a single coordinate whose `Dof` has a `PositionDrive`: its target is
            (u - length_offset) / coefficient, or that of its rate u / coefficient.
        target: of a SERVO.
        gain: (g0, g1, g2) of EFFORT; the law of a SERVO is that of its drive.
        bias: (b0, b1, b2), likewise.
        ctrl_range: the control is clamped to it; None for no bounds.
        force_range: the force is clamped to it; None for no bounds. That of a SERVO is the `effort_limit` of its drive.
        activation: state between control and force.
        early: the force follows the activation at the end of a step, not at its start.
        time_constant: of a filter [s].
        activation_range: the activation is clamped to it.
        delay: of the control [s], rounded to whole sub-steps; before the first one has come through, it is 0.
        torque_speed: (stall force, speed without load) of a motor, in units of f and of l': the force that speeds the
            motion up is at most `stall (1 - |l'| / speed)`, and 0 beyond it.
        corner_speed: below this speed the whole stall force is there, where `torque_speed` is given.
    """

    name: Name
    terms: Annotated[tuple[tuple[int, float], ...], Parsed(_terms)] = ()
    site: Annotated[SitePull, one_of(SitePull)] | None = None
    length_offset: Signed = 0.0
    law: Law = Law.EFFORT
    target: Target = Target.POSITION
    gain: Coefficients = (1.0, 0.0, 0.0)
    bias: Coefficients = (0.0, 0.0, 0.0)
    ctrl_range: Range | None = None
    force_range: Range | None = None
    activation: Activation = Activation.NONE
    early: bool = False
    time_constant: Passive = 0.0
    activation_range: Range | None = None
    delay: Delay = 0.0
    torque_speed: tuple[OfCurve, OfCurve] | None = None
    corner_speed: Passive = 0.0

    @property
    def has_activation(self) -> bool:
        """True if a state stands between control and force."""
        return self.activation is not Activation.NONE

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the control, in the unit of the control, infinite where there are none."""
        return self.ctrl_range or (-math.inf, math.inf)


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
