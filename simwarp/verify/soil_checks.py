"""Soil against closed forms, quadrature along a wheel's contact, and a recorded run of Project Chrono's SCM."""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np
import warp as wp

from simwarp.core.types import WORLD, pose
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.soil import PRESETS, ShearMemory, Soil, SoilSpec, SoilWheel, soil_under
from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.verify.check_result import CheckResult, below, near
from simwarp.verify.recorded_signs import with_iso_signs
from simwarp.verify.soil_rigs import (
    GRAVITY,
    LOAD,
    PLATE_AREA,
    PLATE_RADIUS,
    RADIUS,
    WIDTH,
    DrivenWheel,
    dragged_plate,
    driven_wheels,
    plate_on_slope,
    pressed_plate,
    repeated_passes,
)

RECORDED: Final = {
    "omega_FL_radps": -10.0354, "omega_FR_radps": -10.0606, "omega_RL_radps": -9.9966, "omega_RR_radps": -10.0206,
    "Fz_FL_N": 6425.7, "Fz_FR_N": 5783.6, "Fz_RL_N": 6895.3, "Fz_RR_N": 6205.9,
    "sink_FL_m": 0.0678, "sink_FR_m": 0.0628, "sink_RL_m": 0.0989, "sink_RR_m": 0.0918, "pitch_rad": -0.0117,
}  # fmt: skip
"""Means over t > 2.5 s of a HMMWV_Full on mid soil, throttle 0.7, nodes every 5 cm, steps of 1 ms (Chrono 10), with
the signs of its record.
"""
RECORDED_SPEED: Final = 4.616
"""At its end, 5 s [m/s]."""
SHARES: Final = {"omega": 0.03, "Fz": 0.04, "sink": 0.12}
"""Tolerances: sinkages of a record depend on its rays by some 10 %."""


def soil(device: str = "cpu") -> list[CheckResult]:
    """Plates, standing and driven wheels, passes, a HMMWV.

    A plate is a wheel on its side: its nodes cover a circle to 1 %, and weight put on in 5 s swings 0.5 % past the
    balance. Driven wheels are held at a slip, without damping: their nodes of 1 cm agree with quadrature to 2 %, those
    of 5 cm to 5 %; a standing wheel on hard soil touches 0.2 m of ground. The scalar shear memory is that of the
    quadrature.
    """
    parts = (_plates, _law, _standing, _driven, _pull, _passes, _vehicle)
    return [row for part in parts for row in part(device)]


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


def _law(device: str) -> list[CheckResult]:
    """A plate's way down, up and down again, and along the ground: the law itself, node by node."""
    rows = []
    for name in ("mid", "hard"):
        spec = dataclasses.replace(PRESETS[name], damping=0.0)
        sinkage, pressure = pressed_plate(spec, (0.03, 0.05), device)
        curve = (spec.k_c / PLATE_RADIUS + spec.k_phi) * sinkage**spec.exponent
        turn = int(np.argmax(sinkage >= 0.03))
        origin = sinkage[turn] - curve[turn] / spec.elastic
        line = np.clip(spec.elastic * (sinkage - origin), 0.0, curve)
        off = np.where(np.arange(len(line)) <= turn, pressure - curve, pressure - line) / curve[turn]
        known = sinkage <= 0.03 + 1e-6
        what = f"plate, {name}: off the curve and the elastic line, of the pressure at 3 cm"
        # single precision: half a unit in the last place of 3 cm, 2 nm, along the elastic line, and rounding of powers
        rows.append(below("soil", what, float(np.abs(off[known]).max()), 1e-3))
        for memory in ShearMemory:
            drag = dragged_plate(spec, 0.7, device, memory)
            friction = math.tan(spec.friction_angle)
            full = (PLATE_AREA * spec.cohesion + drag.load * friction) * -np.expm1(-drag.way / spec.shear_length)
            late = drag.way > 0.006  # the direction's millimetre is over
            what = f"plate, {name}, {memory.value} shear: off Janosi's curve from 6 to 18 mm"
            rows.append(below("soil", what, float(np.abs(drag.force / full - 1.0)[late].max()), 0.01))
            crept = plate_on_slope(spec, 0.2, 60.0, device, memory)
            rows.append(below("soil", f"plate, {name}, {memory.value} shear: creep on 20 % in 60 s [m]", crept, 1e-3))
    return rows


def _driven(device: str) -> list[CheckResult]:
    rows = []
    known = {0.1: (0.31, 0.50), 0.4: (0.57, 0.74)}
    quiet = dataclasses.replace(PRESETS["mid"], damping=0.0)
    for spacing, share in ((0.01, 0.02), (0.05, 0.05)):
        found = driven_wheels([DrivenWheel(slip=slip, soil=quiet) for slip in known], spacing, device)
        for index, (slip, (pull, torque)) in enumerate(known.items()):
            name = f"driven wheel, slip {slip:g}, mid, nodes every {100 * spacing:g} cm"
            for quantity, expected, got in (
                ("sinkage [m]", 0.0828, found.sinkage), ("pull / load", pull, found.pull),
                ("torque / (load radius)", torque, found.torque),
            ):  # fmt: skip
                rows.append(near("soil", f"{name}: {quantity}", expected, got[index], share * expected))
    return rows


def _pull(device: str) -> list[CheckResult]:
    """Pull over slip of three soils and loads, shear with a direction: it rises, and stays below friction."""
    slips, names, loads = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6), ("soft", "mid", "hard"), (2000.0, 4000.0, LOAD)
    cases = [
        DrivenWheel(slip=slip, soil=dataclasses.replace(PRESETS[name], damping=0.0), load=load)
        for name in names for load in loads for slip in slips
    ]  # fmt: skip
    pull = driven_wheels(cases, 0.05, device, ShearMemory.DIRECTION).pull.reshape(len(names), -1, len(slips))
    rows = []
    for name, each in zip(names, pull, strict=True):
        fall = float(np.maximum(-np.diff(each, axis=1), 0.0).max())
        rows.append(below("soil", f"pull over slip 0.02 to 0.6, {name}, 2 to 6.3 kN: greatest fall", fall, 0.0))
        if PRESETS[name].cohesion == 0.0:
            beyond = max(0.0, float(each.max()) - math.tan(PRESETS[name].friction_angle))
            rows.append(below("soil", f"pull over slip, {name}: beyond tan phi", beyond, 0.0))
    return rows


def _passes(device: str) -> list[CheckResult]:
    """Ten passes of a wheel: ruts deepen, by less and less."""
    rows = []
    for name in ("soft", "mid", "hard"):
        depths = [float(depth.max()) for _, depth in repeated_passes(PRESETS[name], 10, 0.05, device)]
        gains = np.diff([0.0, *depths])
        wrong = int((gains <= 0.0).sum() + (np.diff(gains) >= 0.0).sum())
        what = f"ten passes, {name}: passes that do not deepen the rut, or not by less"
        rows.append(below("soil", what, wrong, 0.0))
    return rows


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
    for name, known in with_iso_signs(RECORDED).items():
        allowed = 0.003 if name == "pitch_rad" else SHARES[name.partition("_")[0]] * abs(known)
        rows.append(near("soil", f"HMMWV, mid: mean {name}", known, float(run[name][late].mean()), allowed))
    return rows
