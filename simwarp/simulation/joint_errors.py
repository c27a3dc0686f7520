"""Position errors of joints on the host, joint by joint: `diagnostics.position_error` has one number for a world."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.types import RowKind
from simwarp.model.joint_types import ELEMENTS, Row
from simwarp.model.model import Model
from simwarp.model.specifications import Frame, JointSpec
from simwarp.simulation.state import State

Array: TypeAlias = npt.NDArray[np.float64]
Indices: TypeAlias = npt.NDArray[np.integer[Any]]

SOUND_SHARE: Final = 0.05
"""Of a joint's lever: an error settles near half (h ω)² r, so that a turn of 0.3 rad in a step leaves as much."""
SOUND_ANGLE: Final = 0.05
"""[rad], likewise."""
SOUND_GAP: Final = 1.0e-3
"""[m] where a joint has no lever: a wheel turns about its centre."""


UNEQUAL: Final = 100.0
"""Ratio of masses from which a light body that carries a heavy one may vibrate too fast for a step of milliseconds."""


class JointErrors(NamedTuple):
    """Violations of the joints in some worlds.

    Attributes:
        travel: (worlds, J) along the directions that the joint holds [m].
        angle: (worlds, J) about those that it holds [rad].
    """

    travel: Array
    angle: Array


def joint_errors(model: Model, state: State, worlds: Indices) -> JointErrors:
    """How far joints are apart at the present poses of these worlds. Waits for the device."""
    count = len(worlds)
    turn = _matrices(state.body_rot.numpy()[worlds])
    x = state.body_x.numpy()[worlds]
    errors = JointErrors(np.zeros((count, model.joint_count)), np.zeros((count, model.joint_count)))
    anchors = [_rows(array, worlds) for array in (model.joint_anchor0, model.joint_anchor1)]
    frames = [_rows(array, worlds) for array in (model.joint_frame0, model.joint_frame1)]
    offset = _rows(model.joint_offset, worlds)
    for joint, spec in enumerate(model.builder.joints):
        rows = ELEMENTS[spec.type].rows
        if not rows:
            continue
        ends, axes = [], []
        for body, anchor, frame in zip((spec.parent, spec.child), anchors, frames, strict=True):
            inside = body >= 0
            place, f = anchor[:, joint], frame[:, joint]
            ends.append(x[:, body] + np.einsum("wij,wj->wi", turn[:, body], place) if inside else place)
            axes.append(turn[:, body] @ f if inside else f)
        for row in rows:
            value = _violation(row, ends[1] - ends[0], axes[0], axes[1], offset[:, joint])
            into = errors.angle if row.kind == RowKind.DOT else errors.travel
            into[:, joint] = np.hypot(into[:, joint], value)
    return errors


def sound_travels(model: Model) -> Array:
    """(J,) position error of each joint above which the step is too long for what it carries [m]."""
    levers = np.zeros(model.joint_count)
    for joint, spec in enumerate(model.builder.joints):
        arms = [np.linalg.norm(frame.position) for body, frame in _sides(spec) if body >= 0]
        levers[joint] = max(arms, default=0.0)
    longest = float(levers.max(initial=0.0))
    least = min(SOUND_GAP, SOUND_SHARE * longest) if longest > 0.0 else SOUND_GAP
    return np.maximum(SOUND_SHARE * levers, least)


def joints_apart(model: Model, state: State, position_error: wp.array) -> dict[int, str]:
    """A line by world whose joints are apart by more than a sound step leaves. Waits for the device.

    Args:
        model: of these worlds.
        state: present poses.
        position_error: (W,) of the diagnostics, which shows the worlds that are worth a look.
    """
    bounds = sound_travels(model)
    worlds = np.nonzero(~(position_error.numpy() <= min(bounds.min(initial=SOUND_ANGLE), SOUND_ANGLE)))[0]
    found: dict[int, str] = {}
    if not len(worlds):
        return found
    errors = joint_errors(model, state, worlds)
    for row, world in enumerate(worlds.tolist()):
        shares = np.stack([errors.travel[row] / bounds, errors.angle[row] / SOUND_ANGLE])
        if not np.isfinite(shares).all() or shares.max(initial=0.0) <= 1.0:
            continue  # a state that is not finite has a line of its own
        angular, joint = np.unravel_index(int(np.argmax(shares)), shares.shape)
        value = f"{errors.angle[row, joint]:.2g} rad" if angular else f"{errors.travel[row, joint]:.2g} m"
        rule = f"{SOUND_ANGLE:g} rad" if angular else f"{bounds[joint]:.2g} m"
        found[world] = (
            f"joint '{model.joint_names[joint]}' is {value} apart, a sound step leaves less than {rule}; take more "
            f"substeps or a smaller dt{_of_masses(model)}"
        )
    return found


def _of_masses(model: Model) -> str:
    """A hint where bodies of very different masses explain the errors."""
    if model.mass_ratio < UNEQUAL:
        return ""
    return (
        " (position_projection does not help), or make masses more equal: the heaviest body has "
        f"{model.mass_ratio:.2g} times the mass of the lightest, and a light one that carries a heavy one vibrates fast"
    )


def _violation(row: Row, d: Array, axes0: Array, axes1: Array, offset: Array) -> Array:
    """(worlds,) violation of a row [m or rad], from the vector between the anchors and the axes of both frames."""
    match row.kind:
        case RowKind.POINT_AXIS0:
            return np.einsum("wi,wi->w", d, axes0[:, :, row.axis0])
        case RowKind.POINT_AXIS1:
            return np.einsum("wi,wi->w", d, axes1[:, :, row.axis1]) - offset
        case RowKind.DISTANCE:
            return np.linalg.norm(d, axis=1) - offset
        case RowKind.DOT:
            return np.einsum("wi,wi->w", axes0[:, :, row.axis0], axes1[:, :, row.axis1])
        case _:
            raise NotImplementedError(row.kind.name)


def _sides(spec: JointSpec) -> Iterable[tuple[int, Frame]]:
    """Body and frame of both sides of a joint."""
    return (spec.parent, spec.frame0), (spec.child, spec.frame1)


def _rows(array: wp.array, worlds: Indices) -> Array:
    """Rows of a parameter that these worlds have."""
    values = np.asarray(array.numpy(), np.float64)
    return values[worlds] if len(values) > 1 else np.broadcast_to(values, (len(worlds), *values.shape[1:]))


def _matrices(q: Array) -> Array:
    """(..., 3, 3) rotation matrices of (..., 4) xyzw quaternions."""
    v, w = q[..., :3], q[..., 3:, None]
    skew = np.zeros((*q.shape[:-1], 3, 3))
    skew[..., 0, 1], skew[..., 0, 2], skew[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    skew -= np.swapaxes(skew, -1, -2)
    return np.eye(3) + 2.0 * (w * skew + skew @ skew)
