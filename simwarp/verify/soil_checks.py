"""Soil against closed forms, quadrature along a wheel's contact, and a recorded run of Project Chrono's SCM."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Final

import numpy as np
import warp as wp

from simwarp.core.types import WORLD, VelocityMotor, pose
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.soil import PRESETS, ShearMemory, Soil, SoilSpec, SoilWheel, soil_under
from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.verify.check_result import CheckResult, near

RADIUS: Final = 0.467
WIDTH: Final = 0.254
LOAD: Final = 6300.0
"""Of the wheels [N]: a quarter of a HMMWV."""
GRAVITY: Final = 9.81
RECORDED: Final = {
    "omega_FL_radps": -10.0354, "omega_FR_radps": -10.0606, "omega_RL_radps": -9.9966, "omega_RR_radps": -10.0206,
    "Fz_FL_N": 6425.7, "Fz_FR_N": 5783.6, "Fz_RL_N": 6895.3, "Fz_RR_N": 6205.9,
    "sink_FL_m": 0.0678, "sink_FR_m": 0.0628, "sink_RL_m": 0.0989, "sink_RR_m": 0.0918, "pitch_rad": -0.0117,
}  # fmt: skip
"""Means over t > 2.5 s of a HMMWV_Full on mid soil, throttle 0.7, nodes every 5 cm, steps of 1 ms (Chrono 10)."""
RECORDED_SPEED: Final = 4.616
"""At its end, 5 s [m/s]."""
SHARES: Final = {"omega": 0.03, "Fz": 0.04, "sink": 0.12}
"""Tolerances: sinkages of a record depend on its rays by some 10 %."""


def soil(device: str = "cpu") -> list[CheckResult]:
    """Plates, standing and driven wheels, a HMMWV.

    A plate is a wheel on its side: its nodes cover a circle to 1 %, and weight put on in 5 s swings 0.5 % past the
    balance. Driven wheels are held at a slip, without damping: their nodes of 1 cm agree with quadrature to 2 %, those
    of 5 cm to 5 %; a standing wheel on hard soil touches 0.2 m of ground. The scalar shear memory is that of the
    quadrature.
    """
    return [*_plates(device), *_standing(device), *_driven(device), *_vehicle(device)]


def _plates(device: str) -> list[CheckResult]:
    rows = []
    area = 0.1
    for name, load in (("mid", 1.0e4), ("soft", 2.0e3)):
        spec = PRESETS[name]
        expected = (load / (area * spec.k_phi)) ** (1.0 / spec.exponent)
        radius = math.sqrt(area / math.pi)
        got = _sunk(spec, load, 0.01, radius, 0.2, device, disc=True)
        rows.append(near("soil", f"plate of 0.1 m², {load:g} N, {name}: sinkage [m]", expected, got, 0.015 * expected))
    return rows


def _standing(device: str) -> list[CheckResult]:
    rows = []
    for name, expected in (("soft", 0.248), ("mid", 0.0565), ("hard", 0.0110)):
        for spacing, share in ((0.01, 0.02), (0.05, 0.065)):
            got = _sunk(PRESETS[name], LOAD, spacing, RADIUS, WIDTH, device)
            what = f"standing wheel, {name}, nodes every {100 * spacing:g} cm: sinkage [m]"
            rows.append(near("soil", what, expected, got, share * expected))
    return rows


def _sunk(
    spec: SoilSpec, load: float, spacing: float, radius: float, width: float, device: str, *, disc: bool = False
) -> float:
    """How far a wheel or disc sinks that slides along the vertical, its weight put on slowly [m]."""
    builder = ModelBuilder()
    mass, low = load / GRAVITY, 0.5 * width if disc else radius
    turn = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)) if disc else (0.0, 0.0, 0.0, 1.0)
    body = builder.add_body("wheel", mass=mass, inertia=(0.1 * mass,) * 3, pose=pose((0.003, 0.001, low), turn))
    builder.add_joint_prismatic("up", WORLD, body, axis=(0.0, 0.0, 1.0))
    model = builder.finalize(1, device)
    element = Soil(model, [SoilWheel(body=body, radius=radius, width=width)], spec, spacing=spacing)
    simulation = Simulation(model, 1e-3, elements=[element])
    for step in range(600):
        simulation.control.body_force.fill_(wp.vec3(0.0, 0.0, load * max(0.0, 1.0 - step / 480.0)))
        simulation.step(10)
    return low - float(simulation.state.body_x.numpy()[0, 0, 2])


def _driven(device: str) -> list[CheckResult]:
    rows = []
    known = {0.1: (0.31, 0.50), 0.4: (0.57, 0.74)}
    for spacing, share in ((0.01, 0.02), (0.05, 0.05)):
        for slip, (pull, torque) in known.items():
            found = driven_wheel(slip, dataclasses.replace(PRESETS["mid"], damping=0.0), spacing, device)
            name = f"driven wheel, slip {slip:g}, mid, nodes every {100 * spacing:g} cm"
            rows.append(near("soil", f"{name}: pull / load", pull, found["pull"], share * pull))
            rows.append(near("soil", f"{name}: torque / (load radius)", torque, found["torque"], share * torque))
    return rows


def driven_wheel(
    slip: float, spec: SoilSpec, spacing: float, device: str, memory: ShearMemory = ShearMemory.SCALAR,
    load: float = LOAD,
) -> dict[str, float]:  # fmt: skip
    """A wheel that is held at a slip, at 0.5 m/s: pull and torque over its load, sinkage [m], means over 1 m."""
    builder = ModelBuilder()
    mass, speed = load / GRAVITY, 0.5
    sled = builder.add_body("sled", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=pose((0.0, 0.0, RADIUS)))
    carrier = builder.add_body("carrier", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=pose((0.0, 0.0, RADIUS)))
    wheel = builder.add_body("wheel", mass=mass - 1.0, inertia=(20.0, 30.0, 20.0), pose=pose((0.0, 0.0, RADIUS)))
    motor = VelocityMotor(effort_limit=1.0e6)
    builder.add_joint_prismatic("along", WORLD, sled, axis=(1.0, 0.0, 0.0), drive=motor)
    builder.add_joint_prismatic("up", sled, carrier, axis=(0.0, 0.0, 1.0), damping=2.0e4)
    builder.add_joint_revolute("spin", carrier, wheel, axis=(0.0, 1.0, 0.0), drive=motor)
    model = builder.finalize(1, device)
    element = Soil(
        model, [SoilWheel(body=wheel, radius=RADIUS, width=WIDTH)], spec, spacing=spacing, shear_memory=memory
    )
    simulation = Simulation(model, 1e-3, elements=[element])
    for step in range(200):
        simulation.control.body_force.fill_(wp.vec3(0.0, 0.0, load * max(0.0, 1.0 - step / 150.0)))
        simulation.step(10)
    rates: Any = simulation.control.joint_target_qd.numpy()
    rates[0] = [speed, 0.0, speed / (1.0 - slip) / RADIUS]
    simulation.control.joint_target_qd.assign(rates)
    simulation.step(2000)
    rows = []
    for _ in range(400):
        simulation.step(5)
        force, torque = element.force_w.numpy()[0, 0], element.torque_w.numpy()[0, 0]
        deep = RADIUS - simulation.state.body_x.numpy()[0, wheel, 2]
        rows.append((force[0] / load, -torque[1] / (load * RADIUS), deep))
    pull, moment, sinkage = np.mean(rows, axis=0)
    return {"pull": float(pull), "torque": float(moment), "sinkage": float(sinkage)}


def _vehicle(device: str) -> list[CheckResult]:
    spec = with_options(load_vehicle("hmmwv"), tire="soil-rigid")
    setup = set_up(
        spec, maneuver("reference-soil", spec), device=device, elements=lambda vehicle: [soil_under(vehicle, "mid")]
    )
    run = Drive(setup).run()
    late = run["t_s"] > 2.5
    rows = [
        near("soil", "HMMWV, mid: speed after 5 s [m/s]", RECORDED_SPEED, run["speed_mps"][-1], 0.03 * RECORDED_SPEED)
    ]
    for name, known in RECORDED.items():
        allowed = 0.003 if name == "pitch_rad" else SHARES[name.partition("_")[0]] * abs(known)
        rows.append(near("soil", f"HMMWV, mid: mean {name}", known, float(run[name][late].mean()), allowed))
    return rows
