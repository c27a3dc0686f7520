"""Checks of actuators against the model that they move."""

from __future__ import annotations

from typing import Any

import numpy as np

from simwarp.actuators.actuator_spec import Activation, ActuatorSpec, Law, SitePull
from simwarp.core.types import WORLD, DriveMode, ModelError, finite_vector, formatted
from simwarp.model.checks import checked_instances, checked_name, checked_pose, index_within, positive_number
from simwarp.model.effort_routing import EffortRoute
from simwarp.model.model import Model
from simwarp.model.rules import held_fields


def checked_specs(model: Model, specs: Any) -> tuple[ActuatorSpec, ...]:
    """The actuators, all of which fit the model.

    Raises:
        ModelError: one does not, or two have a name or a drive in common.
    """
    kinds, remedy = "a list of ActuatorSpec", "write ActuatorSpec(name=..., terms=...)"
    listed = checked_instances("Actuators", "specs", specs, ActuatorSpec, kinds, remedy)
    names: set[str] = set()
    driven: dict[tuple[int, int], str] = {}
    for spec in listed:
        thing = checked_name("actuator", spec.name)
        if spec.name in names:
            raise ModelError(f"{thing}: the name is taken by another actuator; choose one of its own")
        names.add(spec.name)
        held_fields(thing, ActuatorSpec, vars(spec))
        _check_transmission(thing, spec, model)
        _check_laws(thing, spec)
        if spec.law is Law.SERVO:
            _check_servo(thing, spec, model)
            place = (spec.terms[0][0], int(spec.target))
            if place in driven:
                raise ModelError(
                    f"{thing}: a drive has one target, but actuator '{driven[place]}' writes it too; "
                    "give one of them Law.EFFORT"
                )
            driven[place] = spec.name
    return listed


def _check_transmission(thing: str, spec: ActuatorSpec, model: Model) -> None:
    """What it pulls on exists and can be moved."""
    if (spec.site is None) == (not spec.terms):
        given = "both" if spec.terms else "neither"
        raise ModelError(f"{thing}: give terms or a site, got {given}; an actuator pulls on one of them")
    if spec.site is not None:
        _check_site(thing, spec.site, model)
    for column, coefficient in spec.terms:
        if not 0 <= column < model.dof_count:
            raise ModelError(
                f"{thing}: column must be in 0..{model.dof_count - 1}, got {formatted(column)}; take model.dof(name)"
            )
        if coefficient == 0.0:
            raise ModelError(f"{thing}: coefficient must not be 0, got {formatted(coefficient)}; leave the term out")
        if model.effort_models[column].mode >= DriveMode.PRESCRIBED_POSITION:
            raise ModelError(
                f"{thing}: joint '{_joint_name(model, column)}' has a prescribed motion, which no force changes; "
                "leave out its drive"
            )


def _check_site(thing: str, site: SitePull, model: Model) -> None:
    ends: list[tuple[str, Any, int]] = [("body", site.body, 0 if site.reference is None else WORLD)]
    if site.reference is not None:
        ends.append(("reference", site.reference, WORLD))
    for role, body, least in ends:
        rule = f"site {role} must be a body index in 0..{model.body_count - 1}{' or WORLD' if least == WORLD else ''}"
        index_within(thing, rule, body, model.body_count, "take model.body(name)", least=least)
    if site.body == site.reference:
        raise ModelError(f"{thing}: site body and reference must differ, got {site.body} for both; leave one out")
    checked_pose(thing, site.pose)
    checked_pose(thing, site.reference_pose)
    if not finite_vector(thing, "site gear", site.gear, 6).any():
        raise ModelError(
            f"{thing}: site gear must not be zero throughout, got {formatted(site.gear)}; give a direction"
        )


def _check_laws(thing: str, spec: ActuatorSpec) -> None:
    """Fields that need each other."""
    if spec.activation in (Activation.FILTER, Activation.FILTER_EXACT):
        positive_number(thing, "time_constant", spec.time_constant, "s", "use Activation.NONE for no filter")
    if spec.activation_range is not None and not spec.has_activation:
        raise ModelError(f"{thing}: activation_range needs an activation, got Activation.NONE; leave the range out")
    if spec.torque_speed is None and spec.corner_speed != 0.0:
        raise ModelError(f"{thing}: corner_speed needs torque_speed, got None; give (stall force, free speed)")
    if spec.torque_speed is not None and spec.corner_speed >= spec.torque_speed[1]:
        free, corner = spec.torque_speed[1], spec.corner_speed
        raise ModelError(f"{thing}: corner_speed must be below the free speed {free:g}, got {corner:g}; lower it")


def _check_servo(thing: str, spec: ActuatorSpec, model: Model) -> None:
    """A servo hangs on the drive of one coordinate."""
    if len(spec.terms) != 1:
        raise ModelError(
            f"{thing}: a SERVO moves one coordinate, got {len(spec.terms)} terms; "
            "make their sum one with add_combination, or take Law.EFFORT"
        )
    if spec.torque_speed is not None:
        raise ModelError(f"{thing}: a SERVO has no torque_speed, its drive is implicit; take Law.EFFORT")
    column = spec.terms[0][0]
    effort = model.effort_models[column]
    if effort.mode is not DriveMode.POSITION or effort.path is EffortRoute.BODY_FORCE:
        raise ModelError(
            f"{thing}: a SERVO needs a PositionDrive on joint '{_joint_name(model, column)}'; "
            "give its coordinate drive=PositionDrive(stiffness=..., damping=...)"
        )
    upper, lower = (getattr(model, f"drive_effort_{end}").numpy()[0, column] for end in ("limit", "lower"))
    lower = -upper if lower > 0.0 else lower  # one that is positive stands for the other side's
    asked = None if spec.force_range is None else np.clip(spec.force_range, -1.0e30, 1.0e30)
    if asked is not None and not np.allclose(asked, np.clip((lower, upper), -1.0e30, 1.0e30), rtol=1e-6):
        raise ModelError(
            f"{thing}: the force_range of a SERVO is that of its drive, {_bounds_text(lower, upper)}, "
            f"got {spec.force_range}; give the PositionDrive this effort_limit"
        )


def _joint_name(model: Model, column: int) -> str:
    joint = int(np.searchsorted(model.joint_dof_start, column, side="right")) - 1
    return model.joint_names[joint]


def _bounds_text(lower: float, upper: float) -> str:
    return "which has none" if lower <= -1.0e30 and upper >= 1.0e30 else f"({lower:g}, {upper:g})"
