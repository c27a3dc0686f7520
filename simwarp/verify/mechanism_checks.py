"""Mechanisms with known answers: periods, published numbers, recorded runs, drift, and joints seen from outside."""

from __future__ import annotations

from importlib.resources import files

import numpy as np
import numpy.typing as npt

from simwarp import scenes
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import SolverOptions
from simwarp.verify.check_result import CheckResult, below, near
from simwarp.verify.probe import Array, HingeRows, Probe, crossings, displaced


def recorded(name: str) -> npt.NDArray[np.void]:
    """A recorded run that is shipped with the package, by column names."""
    with files("simwarp").joinpath("data", name).open(encoding="utf-8") as stream:
        return np.genfromtxt(stream, delimiter=",", names=True)


# ---- a pendulum and a free body ------------------------------------------------------------------------------------


def pendulum(device: str = "cpu") -> list[CheckResult]:
    """Period of a pendulum released horizontally, dt 1 ms.

    The time between two turning points of the same side; the demanded 1e-3 s is one step, and semi-implicit Euler is
    off by a share of it.
    """
    probe = Probe(scenes.pendulum(), 1e-3, device)
    speeds = []
    for _ in range(2500):
        probe.step()
        speeds.append(probe.qd[0])
    # released at rest at t = 0: the second turning point is there again
    turns = crossings(speeds, 1e-3, start=1e-3)
    return [near("pendulum", "period [s]", scenes.PENDULUM_PERIOD, turns[1], 1e-3)]


def dzhanibekov(device: str = "cpu", duration: float = 20.5) -> list[CheckResult]:
    """Flips of a body that spins about its middle axis, dt 1 ms: every interval within the demanded 1 %."""
    probe = Probe(scenes.dzhanibekov(), 1e-3, device)
    rates = []
    for _ in range(round(duration / 1e-3)):
        probe.step()
        rates.append(probe.body_rates[0, 1])
    expected = scenes.FLIP_INTERVAL
    intervals = np.diff(crossings(rates, 1e-3))
    return [
        near("dzhanibekov", f"flip interval {k + 1} [s]", expected, interval, 0.01 * expected)
        for k, interval in enumerate(intervals)
    ]


def free_spin(device: str = "cpu", duration: float = 100.0) -> list[CheckResult]:
    """Energy and momentum of the tumbling body of `dzhanibekov` and of a flying one that does not tumble, dt 1 ms.

    The spin is integrated by the implicit midpoint rule, which keeps energy and the size of the momentum exactly:
    what is left is rounding. If it is unbiased, N steps of relative size 6e-8 walk sqrt(N) 6e-8 far, and an energy
    twice that: 4e-5 in 1e5 steps, of which the bounds take 2.5 standard deviations. A bias of one rounding per step
    would be 6e-3, sixty times the bound. A body without torque or force has nothing to round: its velocity stays.
    """
    probe = Probe(scenes.dzhanibekov(), 1e-3, device)
    energy, momentum = probe.kinetic_energy(), float(np.linalg.norm(probe.angular_momentum()))
    probe.run(duration)
    after = float(np.linalg.norm(probe.angular_momentum()))
    walk = 2.5 * 2.0 * np.sqrt(duration / 1e-3) * 6e-8
    rows = [
        below("free-spin", f"tumbling: kinetic energy, relative change over {duration:g} s",
              probe.kinetic_energy() / energy - 1.0, walk),
        below("free-spin", f"tumbling: |angular momentum|, relative change over {duration:g} s",
              after / momentum - 1.0, walk),
    ]  # fmt: skip
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_body("ball", mass=1.3, inertia=(1.3,) * 3, velocity=(3.0, 0.0, 0.0), omega=(0.0, 0.0, 10.0))
    builder.add_shaft("shaft", inertia=1.3, speed=10.0)
    ball = Probe(builder, 1e-3, device)
    ball.run(duration)
    walk /= 2.0
    return [
        *rows,
        below("free-spin", f"ball: speed, relative change over {duration:g} s", ball.v[0, 0] / 3.0 - 1.0, walk),
        below("free-spin", f"ball: spin, relative change over {duration:g} s", ball.omega[0, 2] / 10.0 - 1.0, walk),
        below("free-spin", f"shaft: speed, relative change over {duration:g} s", ball.qd[0] / 10.0 - 1.0, walk),
    ]


# ---- published and recorded ----------------------------------------------------------------------------------------


def andrews_angles(dt: float, device: str = "cpu") -> Array:
    """Andrews' seven angles [rad] at 0.03 s."""
    probe = Probe(scenes.andrews(), dt, device)
    probe.run(0.03)
    return probe.q[:7] + np.array(scenes.ANDREWS_INITIAL)


def andrews(device: str = "cpu", dt: float = 5e-7) -> list[CheckResult]:
    """Andrews' squeezer at 0.03 s against the published angles.

    A step of first order: the error of the worst angle is about 8e3 dt, so 1e-2 needs 1 µs at least. It halves with
    dt (8 to 4 µs) within 20 %: the second-order part there is a few percent, and rounding enters at small dt. The
    Richardson extrapolation of those two is held to the same 1e-2.
    """
    reference = np.array(scenes.ANDREWS_REFERENCE)
    coarse, fine = andrews_angles(8e-6, device), andrews_angles(4e-6, device)
    finest = andrews_angles(dt, device)
    names = ("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon")
    rows = [
        near("andrews", f"{name}(0.03 s) [rad], dt {dt * 1e6:g} us", expected, got, 1e-2)
        for name, expected, got in zip(names, reference, finest, strict=True)
    ]
    ratio = np.abs(coarse - reference).max() / np.abs(fine - reference).max()
    extrapolated = np.abs(2.0 * fine - coarse - reference).max()
    return [
        *rows,
        near("andrews", "error at dt 8 us over error at 4 us", 2.0, ratio, 0.4),
        below("andrews", "Richardson of 8 and 4 us, largest error [rad]", extrapolated, 1e-2),
    ]


def double_pendulum_error(dt: float, duration: float, device: str = "cpu", column: str = "rk4") -> float:
    """Largest distance [m] of a rod's centre from a recorded run, in x or z, over the samples up to `duration`."""
    record = recorded("double_pendulum.csv")
    record = record[record["t_s"] <= duration + 1e-9]
    expected = np.stack([record[f"{column}_{name}_m"] for name in ("x1", "z1", "x2", "z2")], axis=1)
    probe = Probe(scenes.double_pendulum(), dt, device)
    worst = 0.0
    for k in range(1, len(record)):
        probe.run(record["t_s"][k] - record["t_s"][k - 1])
        worst = max(worst, float(np.abs(probe.x[:, [0, 2]].reshape(-1) - expected[k]).max()))
    return worst


def double_pendulum(device: str = "cpu") -> list[CheckResult]:
    """Double pendulum against an independent RK4 (h 1e-4 s) and recorded Chrono runs, over 5 s.

    Both engines are of first order at 1 ms; Chrono's own distance from RK4 is 2.8 mm there, and ours is held to twice
    that. At 0.1 ms it must be a tenth: 0.57 mm. Chrono's HHT run at 0.1 ms is itself 0.23 mm from RK4, so that 0.8 mm
    is the bound against it.
    """
    record = recorded("double_pendulum.csv")
    columns = ("x1", "z1", "x2", "z2")
    chrono = max(float(np.abs(record[f"chrono_1ms_{c}_m"] - record[f"rk4_{c}_m"]).max()) for c in columns)
    coarse, fine = (double_pendulum_error(dt, 5.0, device) for dt in (1e-3, 1e-4))
    hht = double_pendulum_error(1e-4, 5.0, device, "chrono_hht")
    return [
        below("double-pendulum", "distance from RK4 over 5 s, dt 1 ms [m]", coarse, 2.0 * chrono),
        below("double-pendulum", "distance from RK4 over 5 s, dt 0.1 ms [m]", fine, 0.2 * chrono),
        below("double-pendulum", "distance from Chrono HHT over 5 s, dt 0.1 ms [m]", hht, 0.2 * chrono + 2.3e-4),
    ]


def slider_crank(device: str = "cpu") -> list[CheckResult]:
    """Slider-crank with a prescribed crank speed against geometry and the recorded Chrono run, dt 1 ms, 2 s.

    The crank angle is exact, so that the slider is off by what the guide and the pins drift, h²/2 w² r = 1e-5 m for
    each of the two pins; Chrono's is 1.3e-5. Torques differ by the discretisation alone, a few times h dT/dt: 0.05 %
    of the 77 N·m they reach.
    """
    record = recorded("slider_crank.csv")
    probe = Probe(scenes.slider_crank(), 1e-3, device, joint_reactions=True)
    hinge = probe.model.joint("motor")
    analytic, position, torque = 0.0, 0.0, 0.0
    for k in range(1, len(record)):
        probe.run(record["t_s"][k] - record["t_s"][k - 1])
        x = probe.x[2, 0]
        analytic = max(analytic, abs(x - record["slider_x_analytic_m"][k]))
        position = max(position, abs(x - record["slider_x_m"][k]))
        # Chrono reports the torque with the opposite sign; our axis is -Y
        got = -float(probe.sim.diagnostics.joint_reaction_torque.numpy()[0, hinge][1])
        torque = max(torque, abs(got + record["motor_torque_Nm"][k]))
    return [
        below("slider-crank", "slider from r cos wt + sqrt(l2 - (r sin wt)2) over 2 s [m]", analytic, 2e-5),
        below("slider-crank", "slider from Chrono over 2 s [m]", position, 3.5e-5),
        below("slider-crank", "motor torque from Chrono over 2 s [N·m]", torque, 0.05),
    ]


# ---- joints, seen from outside -------------------------------------------------------------------------------------


def chain_rows(duration: float = 2.0, passes: int = 0, device: str = "cpu") -> tuple[float, float, float]:
    """A 20-link chain released horizontally, dt 1 ms.

    Returns the largest velocity row [m/s or rad/s], position violation over its bound h²/2 (w0² r0 + w1² r1), and
    position violation [m], over all joints and steps.
    """
    dt = 1e-3
    probe = Probe(scenes.chain(20), dt, device, solver=SolverOptions(position_projection=passes))
    rows = HingeRows(probe)
    at = rows.geometry()
    speed = ratio = gap = 0.0
    for _ in range(round(duration / dt)):
        probe.step()
        speed = max(speed, float(rows.speeds(at, dt).max()))
        bound = rows.curvature(at, dt)
        at = rows.geometry()
        gaps = np.linalg.norm(at.gap, axis=1)
        # 10 nm: rounding of h v, float32 at some 10 m/s
        ratio = max(ratio, float((gaps / (bound + 1e-8)).max()))
        gap = max(gap, float(gaps.max()))
    return speed, ratio, gap


PROJECTION_PASSES = 2
"""Passes of position projection that the chain gets: one leaves 8.2e-7, two 2.9e-8, three 2.1e-9 m."""


def chain(device: str = "cpu", duration: float = 2.0) -> list[CheckResult]:
    """Joint rows of a 20-link chain, dt 1 ms, evaluated outside in float64 from the published state.

    Velocity rows J v + C/h + h κ/6 at the two anchors with the poses and the curvature κ of the step's start; float32
    velocities of 20 m/s have steps of 2e-6 m/s, so that the demanded 1e-5 is a handful of roundings. A step along the
    tangent leaves h²/2 w² r at each of a joint's two anchors, times the demanded 1.5. With projection 1e-5 m.
    """
    speed, ratio, _ = chain_rows(duration, 0, device)
    _, _, projected = chain_rows(duration, PROJECTION_PASSES, device)
    return [
        below("chain", "velocity rows, J v + C/h + h κ/6 [m/s]", speed, 1e-5),
        below("chain", "position violation over h2/2 (w0^2 r0 + w1^2 r1)", ratio, 1.5),
        below("chain", f"position violation with {PROJECTION_PASSES} projection passes [m]", projected, 1e-5),
    ]


# ---- closed loops --------------------------------------------------------------------------------------------------


def energy_drift(builder: ModelBuilder, duration: float, device: str = "cpu") -> tuple[float, float, bool]:
    """(energy of the last second against the first, largest excursion, finite), dt 1 ms.

    Energies relative to the largest kinetic energy of the first second: what the motion exchanges. The first is the
    drift: energies oscillate with the motion by O(h), as those of every semi-implicit step do, and means over a second
    take that out.
    """
    probe = Probe(builder, 1e-3, device)
    start = probe.energy()
    samples, kinetic = [], []
    for _ in range(round(duration / 5e-3)):
        probe.step(5)
        samples.append(probe.energy())
        kinetic.append(probe.kinetic_energy())
    scale = max(kinetic[:200])
    excursion = float(np.abs(np.array(samples) - start).max()) / scale
    return float(np.mean(samples[-200:]) - np.mean(samples[:200])) / scale, excursion, probe.finite


def four_bar(device: str = "cpu", duration: float = 100.0) -> list[CheckResult]:
    """A planar four-bar with three redundant rows, turning freely: energy drift below the demanded 1 %."""
    drift, excursion, finite = energy_drift(scenes.four_bar(), duration, device)
    return [
        near("four-bar", f"finite after {duration:g} s", 1.0, finite, 0.0),
        below("four-bar", f"energy drift over {duration:g} s / kinetic energy", drift, 1e-2),
        below("four-bar", f"largest energy error over {duration:g} s / kinetic energy", excursion, 1e-2),
    ]


def bricard(device: str = "cpu", duration: float = 100.0) -> list[CheckResult]:
    """Bricard's mechanism, one redundant row in every configuration: energy drift below the demanded 1 %."""
    drift, excursion, finite = energy_drift(scenes.bricard(), duration, device)
    return [
        near("bricard", f"finite after {duration:g} s", 1.0, finite, 0.0),
        below("bricard", f"energy drift over {duration:g} s / kinetic energy", drift, 1e-2),
        below("bricard", f"largest energy error over {duration:g} s / kinetic energy", excursion, 1e-2),
    ]


# ---- far away ------------------------------------------------------------------------------------------------------

FAR = np.array([7200.0, -6400.0, 2700.0])
"""[m]; 10 km from the origin, and no round number in float32 once it is added to an anchor."""


def far_away(device: str = "cpu") -> list[CheckResult]:
    """The same runs 10 km from the origin: relative positions within the demanded 1e-3 m.

    Float64 positions resolve 2e-12 m there. A four-bar and a pendulum stay with that; the chain and the double
    pendulum amplify it like any other disturbance, so that they run only for the few seconds in which the answer is
    defined.
    """
    rows = []
    for name, builder, duration in (
        ("double pendulum", scenes.double_pendulum(), 5.0),
        ("20-link chain", scenes.chain(20), 1.0),
        ("four-bar", scenes.four_bar(), 10.0),
        ("Bricard", scenes.bricard(), 10.0),
    ):
        home, away = Probe(builder, 1e-3, device), Probe(displaced(builder, FAR), 1e-3, device)
        worst = 0.0
        for _ in range(round(duration / 0.05)):
            home.run(0.05)
            away.run(0.05)
            worst = max(worst, float(np.abs(away.x - FAR - home.x).max()))
        rows.append(below("far-away", f"{name}, relative motion over {duration:g} s [m]", worst, 1e-3))
    return rows
