"""Laws that hold for any mechanism, and single elements with motions in closed form. dt is 1 ms by default."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simwarp import scenes
from simwarp.core.types import (
    WORLD,
    Dof,
    PositionDrive,
    PrescribedPosition,
    PrescribedSpeed,
    VelocityMotor,
    pose,
)
from simwarp.model.builder import ModelBuilder
from simwarp.verify.check_result import CheckResult, below, near
from simwarp.verify.probe import Array, Probe

G = 9.81
DT = 1e-3
NO_GRAVITY = (0.0, 0.0, 0.0)
ROUNDING = 6e-8
"""Half a unit in the last place of float32, relative."""


# ---- conservation --------------------------------------------------------------------------------------------------


def momentum_changes(builder: ModelBuilder, dt: float, duration: float, rates: Array, device: str = "cpu") -> tuple[
    float, float, float
]:  # fmt: skip
    """Changes of linear and angular momentum relative to sum of m |v| and sum of |x| m |v| + |I w|, and steps taken.

    `rates` are those of the joints at the start [m/s, rad/s].
    """
    probe = Probe(builder, dt, device)
    probe.sim.set_joint_state(None, np.zeros(probe.model.dof_count), rates)
    linear, angular = probe.linear_momentum(), probe.angular_momentum()
    speeds = probe.mass * np.linalg.norm(probe.v, axis=1)
    spin = np.linalg.norm(np.einsum("bij,bj->bi", probe.inertia, probe.body_rates), axis=1)
    size = float(np.sum(np.linalg.norm(probe.x, axis=1) * speeds + spin))
    steps = round(duration / dt)
    probe.step(steps)
    return (
        float(np.linalg.norm(probe.linear_momentum() - linear)) / float(np.sum(speeds)),
        float(np.linalg.norm(probe.angular_momentum() - angular)) / size,
        steps,
    )


def momentum(device: str = "cpu", seed: int = 1) -> list[CheckResult]:
    """A floating random tree of ten bodies, turning joints of all kinds, no gravity, 1 s.

    Joint impulses come in pairs, so that linear momentum changes by rounding alone: N steps of one rounding per body
    walk 4 sqrt(N) 6e-8 far (four standard deviations). Angular momentum is that of the impulses at the poses of the
    step's start: orbital parts are exact (x' x v = x x v), but each body's spin turns by h w at the new rate against
    the midpoint's, which is O(h²) in a step and O(h) in a second: h w of the 3 rad/s here, 3e-3. From 4 ms to 2 ms it
    halves, within 20 % for the terms of second order and the rounding.
    """
    builder = scenes.floating_tree(seed)
    rates = np.random.default_rng(seed).normal(size=builder.dof_count)
    linear, angular, steps = momentum_changes(builder, DT, 1.0, rates, device)
    _, coarse, _ = momentum_changes(builder, 4.0 * DT, 1.0, rates, device)
    _, half, _ = momentum_changes(builder, 2.0 * DT, 1.0, rates, device)
    return [
        below("momentum", "linear, relative change in 1 s", linear, 4.0 * math.sqrt(steps) * ROUNDING),
        below("momentum", "angular, relative change in 1 s", angular, 3.0 * DT),
        near("momentum", "angular, change at 4 ms over change at 2 ms", 2.0, coarse / half, 0.4),
    ]


def energy(device: str = "cpu") -> list[CheckResult]:
    """Energy of a double pendulum over 20 s: it oscillates by O(h) and does not drift.

    Semi-implicit steps keep a nearby energy. The step's chord leaves the joint by h²/2 w² r and the correction feeds
    back some h w of the energy exchanged: rates are 10 rad/s at most, h w 1 %.
    """
    probe = Probe(scenes.double_pendulum(), DT, device)
    start, worst, scale = probe.energy(), 0.0, 0.0
    for _ in range(2000):
        probe.step(10)
        worst = max(worst, abs(probe.energy() - start))
        scale = max(scale, probe.kinetic_energy())
    return [below("energy", "double pendulum, largest error over 20 s / kinetic energy", worst / scale, 0.01)]


# ---- reactions -----------------------------------------------------------------------------------------------------


def reactions(device: str = "cpu") -> list[CheckResult]:
    """A 7 kg body hangs at rest from one joint of each kind: its force is m g upwards, its torque r x m g.

    The body's centre is 0.3 m from the anchor sideways where the joint can take the torque. Float32 impulses of
    m g h against momenta of a body at rest: 1e-5 of m g, some hundred roundings.
    """
    mass, side = 7.0, 0.3
    rows = []
    up, away = (0.0, 0.0, 0.0), (-side, 0.0, 0.0)
    cases = {
        "fixed": (away, lambda b, k: b.add_joint_fixed("j", WORLD, k, anchor=away)),
        "revolute": (away, lambda b, k: b.add_joint_revolute("j", WORLD, k, anchor=away, axis=(1.0, 0.0, 0.0))),
        "prismatic": (away, lambda b, k: b.add_joint_prismatic("j", WORLD, k, anchor=away, axis=(1.0, 0.0, 0.0))),
        "planar": (away, lambda b, k: b.add_joint_planar("j", WORLD, k, anchor=away, normal=(0.0, 0.0, 1.0))),
        "spherical": (up, lambda b, k: b.add_joint_spherical("j", WORLD, k, anchor=(0.0, 0.0, 0.5))),
        "rod": (up, lambda b, k: b.add_joint_distance("j", WORLD, k, anchor0=(0.0, 0.0, 0.5), anchor1=up)),
        "reversed revolute": (
            away, lambda b, k: b.add_joint_revolute("j", k, WORLD, anchor=away, axis=(1.0, 0.0, 0.0)),
        ),
    }  # fmt: skip
    for name, (anchor, add) in cases.items():
        builder = ModelBuilder()
        body = builder.add_body("body", mass=mass, inertia=(0.1, 0.1, 0.1))
        add(builder, body)
        probe = Probe(builder, DT, device, joint_reactions=True)
        probe.step(20)
        sign = -1.0 if name.startswith("reversed") else 1.0
        force = sign * probe.sim.diagnostics.joint_reaction_force.numpy()[0, 0].astype(float)
        torque = sign * probe.sim.diagnostics.joint_reaction_torque.numpy()[0, 0].astype(float)
        weight = np.array([0.0, 0.0, mass * G])
        expected = -np.cross(np.array(anchor), weight)
        rows += [
            near("reactions", f"{name}: force [N]", mass * G, force[2], 1e-5 * mass * G),
            below("reactions", f"{name}: sideways force and torque beside r x m g [N, N·m]",
                  float(np.abs(np.concatenate([force[:2], torque - expected])).max()), 1e-5 * mass * G),
        ]  # fmt: skip
    return rows


# ---- springs -------------------------------------------------------------------------------------------------------


def _slider(mass: float = 2.0, gravity: tuple[float, float, float] = (0.0, 0.0, -G), **options: Any) -> ModelBuilder:
    """A body on a vertical slide, q upwards."""
    builder = ModelBuilder(gravity=gravity)
    body = builder.add_body("body", mass=mass, inertia=(0.1, 0.1, 0.1))
    builder.add_joint_prismatic("slide", WORLD, body, axis=(0.0, 0.0, 1.0), **options)
    return builder


def springs(device: str = "cpu") -> list[CheckResult]:
    """Springs and dampers that are stiff for the step (h² k / m = 12 and more) settle at m g / k and stay finite.

    Backward Euler damps: 1 s is a thousand time constants. Settled lengths carry float32 rounding of forces m g at
    1e-5, and a bushing's of its coordinate.
    """
    mass, k, d = 2.0, 2.4e7, 1.0e3
    sag = -mass * G / k
    beam = ModelBuilder()
    body = beam.add_body("body", mass=mass, inertia=(0.1, 0.1, 0.1))
    beam.add_bushing("bush", WORLD, body, anchor=(0.0, 0.0, 0.0), stiffness=[k] * 6, damping=[d] * 6)
    line = ModelBuilder()
    body = line.add_body("body", mass=mass, inertia=(0.1, 0.1, 0.1))
    line.add_joint_prismatic("slide", WORLD, body, axis=(0.0, 0.0, 1.0))
    line.add_spring("spring", WORLD, body, anchor0=(0.0, 0.0, -1.0), anchor1=(0.0, 0.0, 0.0), stiffness=k, damping=d)
    rows = []
    for name, builder in (
        ("joint spring", _slider(mass, stiffness=k, damping=d)), ("spring element", line), ("bushing", beam),
    ):  # fmt: skip
        probe = Probe(builder, DT, device)
        worst = 0.0
        for _ in range(1000):
            probe.step()
            worst = max(worst, abs(probe.x[0, 2]))
        # float32 of a 1 m long spring: 6e-8 m, and as much in q
        rows += [
            near("springs", f"{name}: sag m g / k [m]", sag, probe.x[0, 2], 1e-4 * abs(sag) + 6e-8),
            below("springs", f"{name}: largest displacement [m]", worst, 2.0 * abs(sag) + 6e-8),
        ]
    # a soft one against its own formula: x'' = -k/m x, backward Euler loses k h / 2m of the amplitude a second
    stiffness, amplitude = 50.0, 0.1
    probe = Probe(_slider(mass, NO_GRAVITY, stiffness=stiffness, rest=-amplitude), DT, device)
    omega = math.sqrt(stiffness / mass)
    probe.run(2.0 * math.pi / omega)
    lost = 1.0 - math.exp(-math.pi * omega * DT)
    moved = probe.q[0]
    rows.append(near("springs", "undamped oscillator after one period [m]", -amplitude * lost, moved, 0.02 * amplitude))
    return rows


# ---- limits, friction, motors --------------------------------------------------------------------------------------


def limits(device: str = "cpu") -> list[CheckResult]:
    """A pendulum falls onto a stop at 1 rad; a slide runs onto one at 2 m/s. Neither gains energy.

    Impacts are plastic. Before, energy errs by h g v / 2 per second of fall (semi-implicit): 1e-2 m g h at most. A
    stop at velocity level holds gap / h as its bound, so that a coordinate ends on the limit to its own rounding.
    """
    builder = ModelBuilder()
    body = builder.add_body("bob", mass=1.0, inertia=(0.01, 0.01, 0.01), pose=pose((1.0, 0.0, 0.0)))
    axis = (0.0, 1.0, 0.0)
    builder.add_joint_revolute("hinge", WORLD, body, axis=axis, anchor=(0.0, 0.0, 0.0), limit=(-1.0, 1.0))
    probe = Probe(builder, DT, device)
    start, gained, beyond = probe.energy(), 0.0, 0.0
    for _ in range(1500):
        probe.step()
        gained = max(gained, probe.energy() - start)
        beyond = max(beyond, probe.q[0] - 1.0)
    rows = [
        below("limits", "pendulum: energy gained [J]", gained, 0.01 * G),
        below("limits", "pendulum: beyond the stop [rad]", beyond, 1e-6),
        near("limits", "pendulum: rests on the stop at [rad]", 1.0, probe.q[0], 1e-6),
        below("limits", "pendulum: speed on the stop [rad/s]", abs(probe.qd[0]), 1e-5),
    ]
    both = ModelBuilder(gravity=NO_GRAVITY)
    body = both.add_body("body", mass=3.0, inertia=(0.1, 0.1, 0.1), velocity=(2.0, 0.0, 0.0))
    both.add_joint_prismatic("slide", WORLD, body, axis=(1.0, 0.0, 0.0), limit=(-0.3, 0.3))
    probe = Probe(both, DT, device)
    probe.sim.control.joint_force.fill_(5.0)
    start, gained = probe.kinetic_energy(), 0.0
    for _ in range(1000):
        probe.step()
        # the constant force works along the way
        gained = max(gained, probe.kinetic_energy() - start - 5.0 * probe.q[0])
    return [
        *rows,
        # one step's work of the force, 5 N x 2 mm
        below("limits", "slide: energy gained beyond the work of its force [J]", gained, 0.01),
        near("limits", "slide: rests on the stop at [m]", 0.3, probe.q[0], 1e-6),
    ]


def friction(device: str = "cpu") -> list[CheckResult]:
    """Dry friction of 6 N on a 2 kg slide: stops from 1.5 m/s, holds 5.9 N, lets 7 N through at (7 - 6)/2 m/s².

    Steps are exact in velocity; the way is that of semi-implicit Euler, v0²/(2a) - h v0 / 2, off by at most a step.
    """
    effort, mass, speed = 6.0, 2.0, 1.5
    builder = ModelBuilder()
    body = builder.add_body("body", mass=mass, inertia=(0.1, 0.1, 0.1), velocity=(speed, 0.0, 0.0))
    builder.add_joint_prismatic("slide", WORLD, body, axis=(1.0, 0.0, 0.0), friction=effort)
    probe = Probe(builder, DT, device)
    probe.run(0.25)
    decel = effort / mass
    rows = [near("friction", "speed after 0.25 s [m/s]", speed - 0.25 * decel, probe.qd[0], 1e-5)]
    probe.run(0.75)
    rows.append(near("friction", "stops after [m]", 0.5 * speed**2 / decel, probe.q[0], speed * DT))
    stopped = probe.q[0]
    probe.sim.control.joint_force.fill_(5.9)
    probe.run(1.0)
    rows.append(below("friction", "creep in 1 s under 5.9 N [m]", probe.q[0] - stopped, 1e-6))
    probe.sim.control.joint_force.fill_(7.0)
    probe.run(1.0)
    return [*rows, near("friction", "speed after 1 s of 7 N [m/s]", 0.5, probe.qd[0], 1e-4)]


def motors(device: str = "cpu") -> list[CheckResult]:
    """A velocity motor of 4 N·m on a 0.5 kg·m² hinge: 8 rad/s² up to its speed, which it holds against 3.9 N·m and
    loses against 5 N·m at -2 rad/s².

    Velocities are exact but for rounding. A thousand equal increments of 2e-3 rad/s, each rounded to a float32 of 5
    rad/s the same way, would be 2.4e-4 off: 1e-4 asks for a step that does not lose what it rounds.
    """
    builder = ModelBuilder(gravity=NO_GRAVITY)
    body = builder.add_body("body", mass=1.0, inertia=(0.5, 0.5, 0.5))
    builder.add_joint_revolute("hinge", WORLD, body, axis=(0.0, 0.0, 1.0), drive=VelocityMotor(effort_limit=4.0))
    probe = Probe(builder, DT, device)
    probe.sim.control.joint_target_qd.fill_(6.0)
    probe.run(0.5)
    rows = [near("motors", "speed after 0.5 s at its effort limit [rad/s]", 4.0, probe.qd[0], 1e-4)]
    probe.run(0.5)
    rows.append(near("motors", "speed reached [rad/s]", 6.0, probe.qd[0], 1e-5))
    probe.sim.control.joint_force.fill_(-3.9)
    probe.run(0.5)
    rows.append(near("motors", "speed held against 3.9 N·m [rad/s]", 6.0, probe.qd[0], 1e-5))
    probe.sim.control.joint_force.fill_(-5.0)
    probe.run(1.0)
    return [*rows, near("motors", "speed after 1 s against 5 N·m [rad/s]", 4.0, probe.qd[0], 1e-4)]


def drives(device: str = "cpu") -> list[CheckResult]:
    """PD drives on a 2 kg vertical slide: target less m g / k; with an effort limit, the same where it can hold.

    Settled to rounding. Below its weight a drive falls, at (m g - limit) / m.
    """
    mass, k, d, target = 2.0, 4000.0, 200.0, 0.25
    rows = []
    for name, limit in (("unbounded", math.inf), ("40 N", 40.0), ("19.63 N", 19.63)):
        drive = PositionDrive(stiffness=k, damping=d, effort_limit=limit)
        probe = Probe(_slider(mass, drive=drive), DT, device)
        probe.sim.control.joint_target_q.fill_(target)
        probe.run(3.0)
        if limit > 20.0 or math.isinf(limit):
            rows.append(near("drives", f"{name}: settles at target - m g / k [m]", target - mass * G / k,
                             probe.q[0], 1e-5))  # fmt: skip
            rows.append(below("drives", f"{name}: speed when settled [m/s]", abs(probe.qd[0]), 1e-5))
        else:
            # 0.01 N more than the weight: 5 mm/s² upwards
            rows.append(near("drives", f"{name}: speed after 3 s, saturated [m/s]", 0.005 * 3.0, probe.qd[0], 1e-4))
    weak = Probe(_slider(mass, drive=PositionDrive(stiffness=k, damping=d, effort_limit=10.0)), DT, device)
    weak.sim.control.joint_target_q.fill_(target)
    weak.run(1.0)
    return [*rows, near("drives", "10 N: falls, speed after 1 s [m/s]", 10.0 / mass - G, weak.qd[0], 1e-4)]


def prescribed(device: str = "cpu") -> list[CheckResult]:
    """Prescribed positions and speeds follow their tables and the control arrays, under gravity.

    A position is corrected every step to float32 of its rate, h x 1e-7; a speed is given to rounding, and the way is
    the sum of its steps.
    """
    times, values = [0.0, 0.4, 0.7, 2.0], [0.0, 0.5, -0.3, 0.1]
    probe = Probe(_slider(drive=PrescribedPosition(table=(times, values))), DT, device)
    worst = 0.0
    for k in range(1, 1501):
        probe.step()
        worst = max(worst, abs(probe.q[0] - np.interp(k * DT, times, values)))
    rows = [below("prescribed", "position by a table, largest error [m]", worst, 1e-6)]
    probe = Probe(_slider(drive=PrescribedSpeed(table=(times, values))), DT, device)
    worst, way = 0.0, 0.0
    for k in range(1, 1501):
        probe.step()
        speed = float(np.interp(k * DT, times, values))
        way += DT * speed
        worst = max(worst, abs(probe.qd[0] - speed))
    rows += [
        below("prescribed", "speed by a table, largest error [m/s]", worst, 1e-6),
        near("prescribed", "way by a speed table [m]", way, probe.q[0], 1e-5),
    ]
    probe = Probe(_slider(drive=PrescribedPosition()), DT, device)
    worst = 0.0
    for k in range(1, 1001):
        # the target of a step is the position at its start, the rate leads on
        now = (k - 1) * DT
        probe.sim.control.joint_target_q.fill_(0.2 * math.sin(3.0 * now))
        probe.sim.control.joint_target_qd.fill_(0.6 * math.cos(3.0 * now))
        probe.step()
        worst = max(worst, abs(probe.q[0] - 0.2 * math.sin(3.0 * k * DT)))
    # h²/2 of the target's acceleration, 1.8 m/s²: what one step along the tangent misses
    rows.append(below("prescribed", "position by a control array, largest error [m]", worst, 1.05 * 0.9e-6))
    return rows


# ---- couplings -----------------------------------------------------------------------------------------------------


def couplings(device: str = "cpu") -> list[CheckResult]:
    """Gear, rack, screw and a planetary set under a torque: ratios hold, and acceleration is that of the reflected
    inertia.

    One second from rest is exact in velocity but for rounding (1e-5 of it); ratios are rows, corrected every step.
    Coordinates integrate what the rows hold, so that there is nothing to correct: rates keep the ratio to rounding,
    2e-6 rad/s. An angle that is measured in float32 would feed its rounding back as 6e-8 rad / h, 1e-4 rad/s.
    """
    rows = []
    torque = 2.0
    # gear: q1 = -2.5 q0; reflected inertia I0 + ratio² I1
    gear = ModelBuilder(gravity=NO_GRAVITY)
    hinges = []
    for k, inertia in enumerate((0.4, 0.7)):
        body = gear.add_body(f"wheel{k}", mass=1.0, inertia=(inertia,) * 3, pose=pose((float(k), 0.0, 0.0)))
        hinges.append(gear.add_joint_revolute(f"hinge{k}", WORLD, body, axis=(0.0, 0.0, 1.0)))
    gear.add_gear("gear", *hinges, ratio=-2.5)
    probe = _driven(gear, torque, device)
    speed = torque / (0.4 + 2.5**2 * 0.7)
    rows += [
        near("couplings", "gear: speed after 1 s [rad/s]", speed, probe.qd[0], 1e-5 * speed),
        below("couplings", "gear: q1 + 2.5 q0 [rad]", abs(probe.q[1] + 2.5 * probe.q[0]), 2e-6),
        below("couplings", "gear: rates q1 + 2.5 q0 [rad/s]", abs(probe.qd[1] + 2.5 * probe.qd[0]), 2e-6),
    ]
    # rack and pinion: I + m r²
    rack = ModelBuilder(gravity=NO_GRAVITY)
    pinion = rack.add_body("pinion", mass=1.0, inertia=(0.05,) * 3)
    bar = rack.add_body("bar", mass=4.0, inertia=(0.1,) * 3, pose=pose((0.0, 0.1, 0.0)))
    turn = rack.add_joint_revolute("turn", WORLD, pinion, axis=(0.0, 0.0, 1.0))
    slide = rack.add_joint_prismatic("slide", WORLD, bar, axis=(1.0, 0.0, 0.0))
    rack.add_rack("rack", turn, slide, radius=0.1)
    probe = _driven(rack, torque, device)
    speed = torque / (0.05 + 4.0 * 0.01)
    rows += [
        near("couplings", "rack: pinion speed after 1 s [rad/s]", speed, probe.qd[0], 1e-5 * speed),
        below("couplings", "rack: q1 - r q0 [m]", abs(probe.q[1] - 0.1 * probe.q[0]), 2e-6),
    ]
    # screw: m (lead / 2π)² + I, driven in the turn
    screw, lead = ModelBuilder(gravity=NO_GRAVITY), 0.02
    nut = screw.add_body("nut", mass=3.0, inertia=(0.01,) * 3)
    joint = screw.add_joint_cylindrical("screw", WORLD, nut, axis=(0.0, 0.0, 1.0), dofs=[Dof(), Dof(preload=0.2)])
    screw.add_screw("lead", joint, lead=lead)
    probe = Probe(screw, DT, device)
    probe.run(1.0)
    speed = 0.2 / (0.01 + 3.0 * (lead / (2.0 * math.pi)) ** 2)
    rows += [
        near("couplings", "screw: speed after 1 s [rad/s]", speed, probe.qd[1], 1e-5 * speed),
        below("couplings", "screw: advance less lead x turns [m]",
              abs(probe.q[0] - lead / (2.0 * math.pi) * probe.q[1]), 2e-6),
    ]  # fmt: skip
    return [*rows, *_planetary(device)]


def _driven(builder: ModelBuilder, torque: float, device: str) -> Probe:
    """One second under a constant effort on the first coordinate."""
    probe = Probe(builder, DT, device)
    effort = np.zeros((1, probe.model.dof_count), np.float32)
    effort[0, 0] = torque
    probe.sim.control.joint_force.assign(effort)
    probe.run(1.0)
    return probe


def _planetary(device: str) -> list[CheckResult]:
    """Sun, ring and carrier: z_s w_s + z_r w_r = (z_s + z_r) w_c, a torque on each."""
    teeth = np.array([30.0, 66.0, -96.0])
    inertia = np.array([0.02, 0.05, 0.3])
    torque = np.array([1.5, -0.4, 0.7])
    builder = ModelBuilder()
    shafts = [builder.add_shaft(name, inertia=float(inertia[k])) for k, name in enumerate(("sun", "ring", "carrier"))]
    weights = teeth / 30.0
    builder.add_coupling("planets", [(shaft, float(w)) for shaft, w in zip(shafts, weights, strict=True)])
    probe = Probe(builder, DT, device)
    probe.sim.control.joint_force.assign(torque[None].astype(np.float32))
    probe.run(1.0)
    free = torque / inertia
    # one row: the multiplier that keeps weights . w = 0
    expected = free - weights / inertia * (weights @ free) / (weights @ (weights / inertia))
    bound = 1e-5 * float(np.abs(expected).max())
    return [
        *(
            near("couplings", f"planetary: speed of the {name} after 1 s [rad/s]", w, got, bound)
            for name, w, got in zip(("sun", "ring", "carrier"), expected, probe.qd, strict=True)
        ),
        below("couplings", "planetary: z_s q_s + z_r q_r - (z_s + z_r) q_c, of one sun tooth [rad]",
              abs(float(weights @ probe.q)), 1e-5),
    ]  # fmt: skip
