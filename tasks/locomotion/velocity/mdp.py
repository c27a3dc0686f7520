"""Terms of tasks in which a robot on legs follows a velocity: observations, commands, rewards and events.

Plain functions of torch tensors, for all worlds (W) at once and without state: a task calls those it wants in its
six methods, weighs them there, and keeps what must last in buffers of its own. Velocities are in axes of the body
unless said otherwise: x ahead, y to the left, z up.

The terms are those that the field has converged on: Rudin et al. 2022 (Learning to walk in minutes), and the velocity
tasks of legged_gym, Isaac Lab and mjlab.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import torch

from ...framework.rotations import heading_of, in_body_axes
from ...randomisation.randomisation_config import Mode, Range
from ...randomisation.randomness import WorldRandom

__all__ = [
    "action_rate_l2",
    "ang_vel_xy_l2",
    "ang_vel_z_error",
    "base_ang_vel",
    "base_height_l2",
    "base_lin_vel",
    "component_names",
    "drive_torque",
    "feet_air_time",
    "feet_clearance",
    "feet_slide",
    "feet_stumble",
    "flat_orientation_l2",
    "gait_clock",
    "gait_contacts",
    "heading_to_ang_vel",
    "is_moving",
    "joint_acc_l2",
    "joint_l2",
    "joint_pos_limits",
    "joint_power",
    "lin_vel_xy_error",
    "lin_vel_z_l2",
    "projected_gravity",
    "push_by_force",
    "resample_command",
    "resample_heading",
    "reset_joints_by_offset",
    "robot_ranges",
    "stand_still",
    "track_exp",
    "undesired_contacts",
]

# ---- observations ---------------------------------------------------------------------------------------------------


def base_lin_vel(views: Any, body: int) -> torch.Tensor:
    """Return (W, 3) v_b = R^T v, the velocity of a body's centre of mass in its own axes [m/s].

    Args:
        views: of the state (``task.views``).
        body: index.
    """
    return in_body_axes(views.body_q[:, body, 3:], views.body_v[:, body])


def base_ang_vel(views: Any, body: int) -> torch.Tensor:
    """Return (W, 3) omega_b = R^T omega, the angular velocity of a body in its own axes [rad/s].

    Args:
        views: of the state.
        body: index.
    """
    return in_body_axes(views.body_q[:, body, 3:], views.body_omega[:, body])


def projected_gravity(views: Any, body: int) -> torch.Tensor:
    """Return (W, 3) g_b = R^T (0, 0, -1), where down is in axes of a body: (0, 0, -1) where it is upright.

    Args:
        views: of the state.
        body: index.
    """
    x, y, z, w = views.body_q[:, body, 3:].unbind(1)
    down = (2.0 * (w * y - x * z), -2.0 * (w * x + y * z), 2.0 * (x * x + y * y) - 1.0)
    return torch.stack(down, dim=1)


def component_names(**parts: int | Sequence[str]) -> list[str]:
    """Return names of a row that is made of parts, for ``observation_names``.

    Args:
        parts: name of a part -> number of its components, 3 for those along x, y and z; or a name for each.
    """
    names = []
    for part, components in parts.items():
        each = components if not isinstance(components, int) else "xyz" if components == 3 else range(components)
        names += [f"{part} {component}" for component in each]
    return names


def gait_clock(phase: torch.Tensor) -> torch.Tensor:
    """Return (W, 2) sin 2 pi p, cos 2 pi p: where in the cycle of its gait a robot is, without a jump at the end.

    Args:
        phase: (W,) p, in cycles.
    """
    angle = 2.0 * math.pi * phase
    return torch.stack((angle.sin(), angle.cos()), dim=1)


# ---- commands -------------------------------------------------------------------------------------------------------


def resample_command(
    command: torch.Tensor, random: WorldRandom, steps: torch.Tensor, *, every: int, most: torch.Tensor,
    standing: float = 0.0,
) -> torch.Tensor:  # fmt: skip
    """Write new commands c ~ U(-most, most) into the worlds whose time has come, and return which these are, (W,) bool.

    Called at the end of each control step, in ``reset``: a draw is a function of seed, world, episode and step alone,
    so that calling it again changes nothing.

    Args:
        command: (W, 3) velocity ahead, to the left [m/s], and turn to the left [rad/s]; written.
        random: of the task.
        steps: (W,) control steps of the running episodes: 0 in worlds that begin one.
        every: control steps between two commands.
        most: (3,) bounds.
        standing: share of commands that are zero.
    """
    due = steps % every == 0
    drawn = most * random.uniform("command", -1.0, 1.0, size=3, per_step=True)
    if standing > 0.0:
        drawn = drawn * (random.uniform("command: standing", per_step=True) >= standing)
    command.copy_(torch.where(due.unsqueeze(1), drawn, command))
    return due


def resample_heading(heading: torch.Tensor, random: WorldRandom, due: torch.Tensor) -> None:
    """Write new headings into worlds, uniform over the circle [rad].

    Args:
        heading: (W,) commanded heading; written.
        random: of the task.
        due: (W,) bool, what :func:`resample_command` returned.
    """
    drawn = random.uniform("command: heading", -math.pi, math.pi, per_step=True).squeeze(1)
    heading.copy_(torch.where(due, drawn, heading))


def heading_to_ang_vel(rotation: torch.Tensor, heading: torch.Tensor, *, gain: float, most: float) -> torch.Tensor:
    """Return (W,) the turn that leads to a heading, clamp(gain * wrap(heading - psi), -most, most) [rad/s].

    Args:
        rotation: (W, 4) of the body.
        heading: (W,) commanded [rad].
        gain: turn per angle [1/s].
        most: bound [rad/s].
    """
    away = heading - heading_of(rotation)
    return (gain * torch.atan2(away.sin(), away.cos())).clamp(-most, most)


def is_moving(command: torch.Tensor, least: float = 0.1) -> torch.Tensor:
    """Return (W,) float32, 1 where norm(c) > least, and 0 where the robot is to stand.

    Args:
        command: (W, 3) velocities and turn [m/s, rad/s].
        least: of its length.
    """
    return (command.norm(dim=1) > least).float()


# ---- rewards: what is asked for -------------------------------------------------------------------------------------


def lin_vel_xy_error(velocity: torch.Tensor, command: torch.Tensor) -> torch.Tensor:
    """Return (W,) e = norm(v_xy - c_xy), how far the horizontal velocity is from the commanded one [m/s].

    Args:
        velocity: (W, 3) of the body [m/s].
        command: (W, 3) [m/s, m/s, rad/s].
    """
    return (velocity[:, :2] - command[:, :2]).norm(dim=1)


def ang_vel_z_error(turning: torch.Tensor, command: torch.Tensor) -> torch.Tensor:
    """Return (W,) e = abs(omega_z - c_z), how far the turn is from the commanded one [rad/s].

    Args:
        turning: (W, 3) angular velocity of the body [rad/s].
        command: (W, 3) [m/s, m/s, rad/s].
    """
    return (turning[:, 2] - command[:, 2]).abs()


def track_exp(error: torch.Tensor, width: float) -> torch.Tensor:
    """Return (W,) exp(-e^2 / width^2): 1 without an error, 0.37 at the width.

    Args:
        error: (W,) in some unit.
        width: in the same unit.
    """
    return torch.exp(-(error / width).square())


def feet_air_time(
    time_in_air: torch.Tensor, time_in_contact: torch.Tensor, moving: torch.Tensor, *, least: float, longest: float
) -> torch.Tensor:  # fmt: skip
    """Return (W,) number of feet whose swing or stance has lasted least < t < longest, where the robot is to move.

    The usual reward of a landing, clamp(t_air, least, longest) - least, comes as it is earned, and stances earn it too:
    otherwise two feet hop while the others stay up. Feet that tremble, stand for long or stay up earn nothing.

    Args:
        time_in_air, time_in_contact: (W, N) of the feet, one of them 0 [s] (``feet.time_in_air`` and so on).
        moving: (W,) 1 where the robot is to move.
        least, longest: part of a swing or stance that is rewarded [s].
    """
    lasted = torch.maximum(time_in_air, time_in_contact)
    return ((lasted > least) & (lasted < longest)).sum(dim=1) * moving


def gait_contacts(
    touching: torch.Tensor, phase: torch.Tensor, offsets: torch.Tensor, moving: torch.Tensor, *, stance: float
) -> torch.Tensor:  # fmt: skip
    """Return (W,) mean over feet of +1 where a foot touches the ground when the clock says so, or is up when it says
    that, and -1 where it does not. Who is to stand has all feet on the ground.

    Siekmann et al. 2021, "Sim-to-real learning of all common bipedal gaits via periodic reward composition".

    Args:
        touching: (W, N) bool, of the feet.
        phase: (W,) of the clock, in cycles.
        offsets: (N,) of the feet, in cycles: a foot stands while frac(phase + offset) < stance.
        moving: (W,) 1 where the robot is to move.
        stance: share of the cycle in which a foot stands.
    """
    stands = (phase.unsqueeze(1) + offsets).frac() < stance
    stands |= moving.unsqueeze(1) == 0.0
    return torch.where(stands == touching, 1.0, -1.0).mean(dim=1)


def stand_still(joint_error: torch.Tensor, moving: torch.Tensor) -> torch.Tensor:
    """Return (W,) sum abs(q - q_0) where the robot is to stand, else 0 [rad].

    Args:
        joint_error: (W, J) from the stance [rad].
        moving: (W,) 1 where the robot is to move.
    """
    return joint_error.abs().sum(dim=1) * (1.0 - moving)


# ---- rewards: how the body moves ------------------------------------------------------------------------------------


def lin_vel_z_l2(velocity: torch.Tensor) -> torch.Tensor:
    """Return (W,) v_z^2 [m²/s²].

    Args:
        velocity: (W, 3) of the body [m/s].
    """
    return velocity[:, 2].square()


def ang_vel_xy_l2(turning: torch.Tensor) -> torch.Tensor:
    """Return (W,) omega_x^2 + omega_y^2, of roll and pitch [rad²/s²].

    Args:
        turning: (W, 3) angular velocity of the body [rad/s].
    """
    return turning[:, :2].square().sum(dim=1)


def flat_orientation_l2(gravity: torch.Tensor) -> torch.Tensor:
    """Return (W,) g_x^2 + g_y^2 = sin^2 of the angle between the body's z axis and the vertical.

    Args:
        gravity: (W, 3) projected gravity.
    """
    return gravity[:, :2].square().sum(dim=1)


def base_height_l2(height: torch.Tensor, wanted: float) -> torch.Tensor:
    """Return (W,) (h - h_0)^2 of the base over the ground below it [m²].

    Args:
        height: (W,) [m].
        wanted: h_0 [m].
    """
    return (height - wanted).square()


# ---- rewards: how joints and feet move ------------------------------------------------------------------------------


def drive_torque(
    q: torch.Tensor, qd: torch.Tensor, target: torch.Tensor, stiffness: torch.Tensor, damping: torch.Tensor,
    limit: torch.Tensor,
) -> torch.Tensor:  # fmt: skip
    """Return (W, J) tau = clamp(k (q_target - q) - d qd, -limit, limit), torques of position drives now [N·m].

    Args:
        q, qd: (W, J) angles [rad] and rates [rad/s].
        target: (W, J) [rad].
        stiffness, damping, limit: (J,) or (W, J) of the drives (``model.drive_stiffness`` and so on).
    """
    return torch.minimum(torch.maximum(stiffness * (target - q) - damping * qd, -limit), limit)


def joint_l2(values: torch.Tensor) -> torch.Tensor:
    """Return (W,) sum of x^2 over the joints: of torques, of rates, of distances from the stance.

    Args:
        values: (W, J).
    """
    return values.square().sum(dim=1)


def joint_acc_l2(rates: torch.Tensor, before: torch.Tensor, period: float) -> torch.Tensor:
    """Return (W,) sum of ((qd - qd_before) / T)^2 over the joints [rad²/s⁴].

    Args:
        rates, before: (W, J) of the joints, now and a control step before [rad/s].
        period: T, time of a control step [s].
    """
    return joint_l2((rates - before) / period)


def action_rate_l2(action: torch.Tensor, before: torch.Tensor) -> torch.Tensor:
    """Return (W,) sum of (a - a_before)^2 over the components of the action.

    Args:
        action, before: (W, A), now and a control step before.
    """
    return (action - before).square().sum(dim=1)


def joint_power(torque: torch.Tensor, qd: torch.Tensor) -> torch.Tensor:
    """Return (W,) sum abs(tau qd), without recuperation [W].

    Args:
        torque: (W, J) [N·m].
        qd: (W, J) rates [rad/s].
    """
    return (torque * qd).abs().sum(dim=1)


def joint_pos_limits(values: torch.Tensor, low: torch.Tensor, high: torch.Tensor) -> torch.Tensor:
    """Return (W,) sum of max(0, low - x) + max(0, x - high): of angles beyond the soft part of their range.

    Args:
        values: (W, J).
        low, high: (J,) ends of the range that costs nothing.
    """
    return ((low - values).clamp(min=0.0) + (values - high).clamp(min=0.0)).sum(dim=1)


def feet_slide(velocity: torch.Tensor, touching: torch.Tensor) -> torch.Tensor:
    """Return (W,) sum over touching feet of v_x^2 + v_y^2 [m²/s²].

    Args:
        velocity: (W, N, 3) of the feet, axes of the world [m/s] (``feet.velocity()``).
        touching: (W, N) bool.
    """
    return (velocity[:, :, :2].square().sum(dim=2) * touching).sum(dim=1)


def feet_clearance(height: torch.Tensor, velocity: torch.Tensor, wanted: float) -> torch.Tensor:
    """Return (W,) sum over feet of abs(h - h_0) norm(v_xy): a foot that moves fast should be at its height [m²/s].

    Args:
        height: (W, N) of the soles over the ground [m].
        velocity: (W, N, 3) of the feet, axes of the world [m/s].
        wanted: h_0 of a swinging foot [m].
    """
    return ((height - wanted).abs() * velocity[:, :, :2].norm(dim=2)).sum(dim=1)


def feet_stumble(force: torch.Tensor, ratio: float = 4.0) -> torch.Tensor:
    """Return (W,) number of parts with norm(F_xy) > ratio abs(F_z): they hit something steep, as the front of a step.

    Args:
        force: (W, N, 3) contact forces, axes of the world [N].
        ratio: of horizontal to vertical force; beyond any coefficient of friction.
    """
    return (force[:, :, :2].norm(dim=2) > ratio * force[:, :, 2].abs() + 1e-6).sum(dim=1).float()


def undesired_contacts(touching: torch.Tensor) -> torch.Tensor:
    """Return (W,) number of parts that touch something, such as thighs that should not.

    Args:
        touching: (W, N) bool.
    """
    return touching.sum(dim=1).float()


# ---- events ---------------------------------------------------------------------------------------------------------


def push_by_force(
    random: WorldRandom, steps: torch.Tensor, *, every: int, speed: float, mass: float, period: float
) -> torch.Tensor:  # fmt: skip
    """Return (W, 3) F = m dv / T, horizontal forces that kick the robot for one control step [N].

    Its momentum changes by m dv. The direction is uniform over the circle, the speed up to ``speed``. Zero in all but
    one of ``every`` steps; that one is another in each world and episode. For ``body_force`` of the trunk, in
    ``begin_step``.

    Args:
        random: of the task.
        steps: (W,) control steps of the running episodes.
        every: control steps between two pushes.
        speed: largest change of speed [m/s].
        mass: of the robot [kg].
        period: T, time of a control step [s].
    """
    first = random.integers("push: first", 0, every).squeeze(1)
    now = (steps % every == first) & (steps > 0)
    angle = random.uniform("push: direction", -math.pi, math.pi, per_step=True).squeeze(1)
    size = random.uniform("push: speed", 0.0, speed, per_step=True).squeeze(1) * now * (mass / period)
    return torch.stack((size * angle.cos(), size * angle.sin(), torch.zeros_like(size)), dim=1)


def reset_joints_by_offset(random: WorldRandom, purpose: str, around: torch.Tensor, most: float) -> torch.Tensor:
    """Return (W, J) around + U(-most, most), such as angles of joints at the start of an episode [rad].

    Args:
        random: of the task.
        purpose: of the draw.
        around: (J,) or (W, J).
        most: largest deviation.
    """
    return around + random.uniform(purpose, -most, most, size=around.shape[-1])


def robot_ranges(
    trunk: str, feet: Sequence[str], *, friction: tuple[float, float] = (0.5, 1.0), payload: float = 1.0,
    gains: float = 0.1, centre: float = 0.02,
) -> Mapping[str, Range]:  # fmt: skip
    """Return what differs between worlds and episodes, for ``randomise``: friction, load, its place, gains of drives.

    Args:
        trunk: body that carries a load in its centre of mass.
        feet: shapes whose friction is drawn, one number for all; where the smaller one counts, the ground must have
            more.
        friction: range of their coefficients.
        payload: mass that the trunk is at most lighter or heavier by [kg].
        gains: largest deviation of stiffness and damping, as a share.
        centre: largest shift of the trunk's centre of mass along each of its axes [m].
    """
    shifts = {f"body_com_{axis}": Range(-centre, centre, mode=Mode.ADD, only=(trunk,)) for axis in "xyz"}
    return shifts | {
        "shape_friction": Range(*friction, mode=Mode.SET, only=tuple(feet), shared=True),
        "body_mass": Range(-payload, payload, mode=Mode.ADD, only=(trunk,)),
        "drive_stiffness": Range(1.0 - gains, 1.0 + gains),
        "drive_damping": Range(1.0 - gains, 1.0 + gains),
    }


ACTION_DELAY: Final = (0, 1)
"""For ``action_delay``: control steps that a motor's bus and the policy's computation take [least, largest]."""
