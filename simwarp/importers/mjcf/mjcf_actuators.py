"""Actuators and tendons of MJCF: forces affine in control, length and rate; servos as implicit drives."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Final

import mujoco
import numpy as np

from simwarp.actuators import Activation, ActuatorSpec, Law, SitePull, Target
from simwarp.core.types import WORLD, Dof, PositionDrive
from simwarp.importers.imported import NamedFrame
from simwarp.importers.mjcf.mjcf_bodies import is_scalar
from simwarp.importers.mjcf.mjcf_equalities import coordinate_terms
from simwarp.importers.mjcf.mjcf_source import DEFAULT_SOLIMP, DEFAULT_SOLREF, Source

IMPLICIT: Final = "stiffness and damping are implicit, as those of MuJoCo's implicitfast are nearly"


@dataclasses.dataclass(frozen=True)
class Servo:
    """An actuator that pulls its length to its control: of the form kp (u - length) - kv rate.

    Attributes:
        actuator: its index.
        stiffness, damping: along the length.
        target: what it holds.
    """

    actuator: int
    stiffness: float
    damping: float
    target: Target

    def drive(self, gear: float, effort: tuple[float, float]) -> PositionDrive:
        """The drive of a coordinate that moves the length by `gear`; `effort` bounds the force along the length."""
        bounds = sorted(gear * bound for bound in effort)
        return PositionDrive(
            stiffness=self.stiffness * gear * gear,
            damping=self.damping * gear * gear,
            effort_limit=(bounds[0], bounds[1]),
        )


def servos_of(source: Source) -> dict[tuple[str, int], Servo]:
    """Servos by the ("joint" or "tendon", index) that they move; of two on one, both stay plain forces."""
    model = source.model
    found: dict[tuple[str, int], list[Servo]] = {}
    for index in range(model.nactuator):
        transmission = mujoco.mjtTrn(model.actuator_trntype[index])
        if transmission == mujoco.mjtTrn.mjTRN_JOINT and is_scalar(model, model.actuator_trnid[index][0]):
            place = "joint", int(model.actuator_trnid[index][0])
        elif transmission == mujoco.mjtTrn.mjTRN_TENDON:
            place = "tendon", int(model.actuator_trnid[index][0])
        else:
            continue
        servo = _servo(model, index)
        if servo is not None:
            found.setdefault(place, []).append(servo)
    return {place: servos[0] for place, servos in found.items() if len(servos) == 1}


def _servo(model: Any, index: int) -> Servo | None:
    gain, bias = model.actuator_gainprm[index][:3], model.actuator_biasprm[index][:3]
    affine = model.actuator_biastype[index] == mujoco.mjtBias.mjBIAS_AFFINE
    fixed = model.actuator_gaintype[index] == mujoco.mjtGain.mjGAIN_FIXED
    if not affine or not fixed or bias[0] != 0.0 or gain[0] <= 0.0 or bias[1] > 0.0 or bias[2] > 0.0:
        return None
    if bias[1] == -gain[0]:
        return Servo(index, float(gain[0]), -float(bias[2]), Target.POSITION)
    if bias[1] == 0.0 and bias[2] == -gain[0]:
        return Servo(index, 0.0, float(gain[0]), Target.VELOCITY)
    return None


def joint_drives(source: Source, servos: Mapping[tuple[str, int], Servo]) -> dict[int, PositionDrive]:
    """Drives of the joints that servos move, by degree of freedom of the source."""
    model = source.model
    drives = {}
    for (kind, index), servo in servos.items():
        if kind == "joint":
            gear = float(model.actuator_gear[servo.actuator][0])
            effort = force_bounds(model, servo.actuator)
            drives[int(model.jnt_dofadr[index])] = servo.drive(gear, effort)
    return drives


def force_bounds(model: Any, index: int) -> tuple[float, float]:
    """Bounds of an actuator's force: its own, and those of the only joint that only it moves."""
    lower, upper = -math.inf, math.inf
    if model.actuator_forcelimited[index]:
        lower, upper = (float(bound) for bound in model.actuator_forcerange[index])
    joint = _only_joint(model, index)
    if joint is not None and model.jnt_actfrclimited[joint]:
        gear = float(model.actuator_gear[index][0])
        low, high = sorted(float(bound) / gear for bound in model.jnt_actfrcrange[joint])
        lower, upper = max(lower, low), min(upper, high)
    return lower, upper


def _only_joint(model: Any, index: int) -> int | None:
    """The joint of an actuator that is the only one there."""
    joint = _joint_of(model, index)
    if joint is None or model.actuator_gear[index][0] == 0.0:
        return None
    same = [other for other in range(model.nactuator) if _joint_of(model, other) == joint]
    return joint if same == [index] else None


def _joint_of(model: Any, index: int) -> int | None:
    kind = mujoco.mjtTrn(model.actuator_trntype[index])
    if kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        return int(model.actuator_trnid[index][0])
    return None


def add_tendons(source: Source, servos: Mapping[tuple[str, int], Servo]) -> dict[str, int]:
    """Coordinates of the tendons that carry a law; returns our column of each by name."""
    model, report = source.model, source.report
    columns = {}
    for tendon in range(model.ntendon):
        label, first = source.label("tendon", tendon), int(model.tendon_adr[tendon])
        wraps = [mujoco.mjtWrap(model.wrap_type[first + k]) for k in range(int(model.tendon_num[tendon]))]
        _check_tendon(source, tendon)
        if all(wrap == mujoco.mjtWrap.mjWRAP_JOINT for wrap in wraps):
            report.hold("tendon fixed", label)
            column = _add_fixed_tendon(source, tendon, servos.get(("tendon", tendon)))
        elif wraps == [mujoco.mjtWrap.mjWRAP_SITE] * 2:
            ends = [source.data.site_xpos[int(model.wrap_objid[first + k])] for k in range(2)]
            if np.allclose(ends[0], ends[1], rtol=0.0, atol=1e-9):
                report.refuse("spatial tendon", label, "its sites coincide as built, where its direction is undefined")
                continue
            report.hold("tendon spatial", label)
            column = _add_line(source, tendon, servos.get(("tendon", tendon)))
        else:
            report.refuse("spatial tendon", label)
            continue
        if column is not None:
            source.tendons[tendon] = column
            columns[source.name("tendon", tendon)] = column
    return columns


def _check_tendon(source: Source, tendon: int) -> None:
    model, report, label = source.model, source.report, source.label("tendon", tendon)
    if np.any(model.tendon_dampingpoly[tendon]):
        report.refuse("dampingpoly", label)
    if np.any(model.tendon_stiffnesspoly[tendon]):
        report.refuse("stiffnesspoly", label)
    if np.any(model.tendon_springyield[tendon]):
        report.refuse("springyield", label)
    limit = (model.tendon_solref_lim[tendon], model.tendon_solimp_lim[tendon], model.tendon_limited[tendon])
    friction = (model.tendon_solref_fri[tendon], model.tendon_solimp_fri[tendon], model.tendon_frictionloss[tendon])
    for solref, solimp, there in (limit, friction):
        if there and (np.any(solref != DEFAULT_SOLREF) or np.any(solimp != DEFAULT_SOLIMP)):
            report.approximate("tendon solref", label, "stops and dry friction are rigid, without MuJoCo's softness")
    if model.tendon_limited[tendon] and model.tendon_margin[tendon]:
        report.approximate("tendon margin", label, "stops act where they are: margin is 0")
    if model.tendon_actfrclimited[tendon]:
        report.refuse("tendon actuatorfrcrange", label)


def _tendon_dof(source: Source, tendon: int, offset: float, servo: Servo | None) -> Dof:
    """Laws along a tendon, whose length is our coordinate plus `offset`."""
    model = source.model
    stiffness = float(model.tendon_stiffness[tendon])
    low, high = (float(value) - offset for value in model.tendon_lengthspring[tendon])
    slack = None
    if stiffness > 0.0 and high > low:  # no force between the two lengths
        slack = ((low - 1.0, low, high, high + 1.0), (-stiffness, 0.0, 0.0, stiffness))
    limit = None
    if model.tendon_limited[tendon]:
        lower, upper = (float(value) - offset for value in model.tendon_range[tendon])
        limit = (lower, upper)
    drive = None
    if servo is not None:
        gear = float(model.actuator_gear[servo.actuator][0])
        drive = servo.drive(gear, force_bounds(model, servo.actuator))
    return Dof(
        limit=limit, stiffness=0.0 if slack else stiffness, rest=0.0 if slack else low if stiffness else 0.0,
        spring_table=slack, damping=float(model.tendon_damping[tendon]), armature=float(model.tendon_armature[tendon]),
        friction=float(model.tendon_frictionloss[tendon]), drive=drive,
    )  # fmt: skip


def _add_fixed_tendon(source: Source, tendon: int, servo: Servo | None) -> int | None:
    """A combination of coordinates where the tendon has a law of its own; forces alone need none."""
    terms = [
        (*source.builder.coordinate_of(source.dofs[dof]), factor) for dof, factor in coordinate_terms(source, tendon)
    ]
    dof = _tendon_dof(source, tendon, length_at_zero(source, tendon), servo)
    if dof == Dof():
        return None
    options = {field.name: getattr(dof, field.name) for field in dataclasses.fields(dof)}
    joint = source.builder.add_combination(source.name("tendon", tendon), terms, **options)
    return source.builder.dof_start(joint)


def length_at_zero(source: Source, tendon: int) -> float:
    """Length of a fixed tendon where all our coordinates are 0: at the source's `qpos0` [m or rad]."""
    return float(source.model.tendon_length0[tendon])


def _add_line(source: Source, tendon: int, servo: Servo | None) -> int:
    """A tendon straight between two sites: its coordinate is the length."""
    model, data, builder = source.model, source.data, source.builder
    sites = [int(model.wrap_objid[int(model.tendon_adr[tendon]) + k]) for k in range(2)]
    bodies = [source.bodies[model.site_bodyid[site]] for site in sites]
    places = [source.point(data.site_xpos[site]) for site in sites]
    dof = _tendon_dof(source, tendon, 0.0, servo)
    options = {field.name: getattr(dof, field.name) for field in dataclasses.fields(dof)}
    joint = builder.add_spring(
        source.name("tendon", tendon), bodies[0], bodies[1], anchor0=places[0], anchor1=places[1], **options
    )
    return builder.dof_start(joint)


def actuator_specs(source: Source, servos: Mapping[tuple[str, int], Servo]) -> tuple[ActuatorSpec, ...]:
    """The actuators in the order of the file; those that are refused are left out."""
    by_index = {servo.actuator: servo for servo in servos.values()}
    specs = []
    for index in range(source.model.nactuator):
        spec = _spec(source, index, by_index.get(index))
        if spec is not None:
            specs.append(spec)
    return tuple(specs)


def _spec(source: Source, index: int, servo: Servo | None) -> ActuatorSpec | None:
    model, report, label = source.model, source.report, source.label("actuator", index)
    if not _is_known(source, index):
        return None
    where = _transmission(source, index)
    if where is None:
        return None
    activation, constant = _activation(model, index)
    lower, upper = force_bounds(model, index)
    law: dict[str, Any] = {
        "gain": _affine(model.actuator_gainprm[index], model.actuator_gaintype[index] != 0),
        "bias": _affine(model.actuator_biasprm[index], True) if model.actuator_biastype[index] else (0.0, 0.0, 0.0),
        "force_range": (lower, upper) if math.isfinite(lower) or math.isfinite(upper) else None,
    }
    if servo is not None:
        law |= {"law": Law.SERVO, "target": servo.target, "force_range": None}
        report.approximate(f"actuator {servo.target.name.lower()}", label, IMPLICIT)
    else:
        report.hold("actuator general" if model.actuator_biastype[index] else "actuator motor", label)
    return ActuatorSpec(
        name=source.name("actuator", index), activation=activation, time_constant=constant,
        early=bool(model.actuator_actearly[index]) and activation is not Activation.NONE,
        ctrl_range=_range(model.actuator_ctrlrange, model.actuator_ctrllimited, index),
        activation_range=_range(model.actuator_actrange, model.actuator_actlimited, index), **where, **law,
    )  # fmt: skip


def _is_known(source: Source, index: int) -> bool:
    """True where the actuator's kind has a counterpart; otherwise it is refused."""
    model, report, label = source.model, source.report, source.label("actuator", index)
    kinds = {
        mujoco.mjtDyn(model.actuator_dyntype[index]).name.removeprefix("mjDYN_").lower(),
        mujoco.mjtGain(model.actuator_gaintype[index]).name.removeprefix("mjGAIN_").lower(),
        mujoco.mjtBias(model.actuator_biastype[index]).name.removeprefix("mjBIAS_").lower(),
    }
    foreign = sorted(kinds - {"none", "integrator", "filter", "filterexact", "fixed", "affine"})
    refused = [kind if kind == "muscle" else f"actuator {kind}" for kind in foreign[:1]]
    if index in source.shortcuts:
        refused = [source.shortcuts[index]]
    if model.actuator_plugin[index] >= 0:
        refused = ["plugin"]
    if np.any(model.actuator_delay[index]):
        refused.append("delay")
    if np.any(model.actuator_dampingpoly[index]):
        refused.append("dampingpoly")
    if model.actuator_armature[index] or model.actuator_damping[index]:
        refused.append("actuator armature")
    for kind in refused:
        report.refuse(kind, label)
    return not refused


def _transmission(source: Source, index: int) -> dict[str, Any] | None:
    """Fields of the spec that say what the actuator pulls on."""
    model, report, label = source.model, source.report, source.label("actuator", index)
    kind, target = mujoco.mjtTrn(model.actuator_trntype[index]), int(model.actuator_trnid[index][0])
    gear = model.actuator_gear[index]
    pull = float(gear[0])
    if kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        if not is_scalar(model, target):
            site = _joint_pull(source, index, target)
            if site is None:
                report.refuse("actuator on ball or free joint", label)
                return None
            return {"site": site}
        dof = int(model.jnt_dofadr[target])
        offset = pull * float(model.qpos0[model.jnt_qposadr[target]])
        return {"terms": ((source.dofs[dof], pull),), "length_offset": offset}
    if kind == mujoco.mjtTrn.mjTRN_TENDON:
        return _tendon_transmission(source, target, pull, label)
    if kind == mujoco.mjtTrn.mjTRN_SITE:
        return {"site": _site_pull(source, index, gear)}
    word = kind.name.removeprefix("mjTRN_").lower()
    report.refuse({"slidercrank": "slidercrank", "body": "adhesion"}.get(word, f"transmission {word}"), label)
    return None


def _tendon_transmission(source: Source, tendon: int, pull: float, label: str) -> dict[str, Any] | None:
    model = source.model
    if tendon in source.tendons:
        column = source.tendons[tendon]
        is_line = not coordinate_terms_only(model, tendon)
        offset = 0.0 if is_line else pull * length_at_zero(source, tendon)
        return {"terms": ((column, pull),), "length_offset": offset}
    if not coordinate_terms_only(model, tendon):
        source.report.approximate("actuator tendon", label, "left out with its tendon")
        return None
    terms = tuple((source.dofs[dof], pull * factor) for dof, factor in coordinate_terms(source, tendon))
    return {"terms": terms, "length_offset": pull * length_at_zero(source, tendon)}


def coordinate_terms_only(model: Any, tendon: int) -> bool:
    """True of fixed tendons."""
    first = int(model.tendon_adr[tendon])
    wraps = model.wrap_type[first : first + int(model.tendon_num[tendon])]
    return bool((wraps == mujoco.mjtWrap.mjWRAP_JOINT).all())


def _joint_pull(source: Source, index: int, joint: int) -> SitePull | None:
    """The pull of an actuator on a ball or free joint: a torque on the child about axes of the child or, of
    "jointinparent", of the parent, which takes the reaction; the length of a ball is that along its rotation vector.
    None: there is no single frame for it.
    """
    model = source.model
    parent, child = source.ends[joint]
    gear = np.array(model.actuator_gear[index], np.float64)
    in_parent = model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_JOINTINPARENT
    body = int(model.jnt_bodyid[joint])
    if mujoco.mjtJoint(model.jnt_type[joint]) == mujoco.mjtJoint.mjJNT_FREE:
        frame = source.attached(child, source.pose(source.data.xpos[body], source.data.xquat[body]))
        if not gear[:3].any() and not in_parent:
            return _pull(frame, gear)
        turns_in_child = gear[3:].any() and not in_parent
        with_length = any(model.actuator_biasprm[index][1:2]) or any(model.actuator_gainprm[index][1:2])
        if turns_in_child or with_length:  # its length would be that of our reference, where MuJoCo's is 0
            return None
        return _pull(frame, gear, NamedFrame(WORLD, source.placement))
    built = source.pose(source.data.xanchor[joint], source.data.xquat[body])
    outer, inner = source.attached(parent, built), source.attached(child, built)
    turning = np.concatenate([np.zeros(3), gear[:3]])
    return _pull(inner, turning, outer) if in_parent else _pull(outer, -turning, inner)


def _pull(frame: NamedFrame, gear: Any, reference: NamedFrame | None = None) -> SitePull:
    """A pull on a frame, seen from a reference if there is one."""
    numbers: Any = tuple(float(value) for value in gear)
    if reference is None:
        return SitePull(body=frame.body, pose=frame.pose, gear=numbers)
    return SitePull(
        body=frame.body, pose=frame.pose, gear=numbers, reference=reference.body, reference_pose=reference.pose
    )


def _site_pull(source: Source, index: int, gear: Any) -> SitePull:
    model, data = source.model, source.data
    site, reference = (int(value) for value in model.actuator_trnid[index][:2])

    def placed(number: int) -> NamedFrame:
        body = int(model.site_bodyid[number])
        return source.frame(body, source.pose_of_axes(data.site_xpos[number], data.site_xmat[number]))

    return _pull(placed(site), gear, placed(reference) if reference >= 0 else None)


def _activation(model: Any, index: int) -> tuple[Activation, float]:
    kind = mujoco.mjtDyn(model.actuator_dyntype[index])
    found = {
        mujoco.mjtDyn.mjDYN_INTEGRATOR: Activation.INTEGRATOR,
        mujoco.mjtDyn.mjDYN_FILTER: Activation.FILTER,
        mujoco.mjtDyn.mjDYN_FILTEREXACT: Activation.FILTER_EXACT,
    }.get(kind, Activation.NONE)
    constant = float(model.actuator_dynprm[index][0]) if found in (Activation.FILTER, Activation.FILTER_EXACT) else 0.0
    return found, constant


def _affine(numbers: Any, affine: bool) -> tuple[float, float, float]:
    values = [float(value) for value in numbers[:3]]
    return (values[0], values[1], values[2]) if affine else (values[0], 0.0, 0.0)


def _range(ranges: Any, limited: Any, index: int) -> tuple[float, float] | None:
    if not limited[index]:
        return None
    return float(ranges[index][0]), float(ranges[index][1])
