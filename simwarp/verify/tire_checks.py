"""A vehicle's flexible tire pressed on a road: its load and stiffness against a mesh of four times the cells; part of
the scene "flexible".
"""

from __future__ import annotations

from typing import Final

import numpy as np

from simwarp.core.types import WORLD, Material, PositionDrive, pose
from simwarp.flex import Options
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle import load_vehicle, with_options
from simwarp.vehicle.tires.flexible_tires import TireShell
from simwarp.verify.check_result import CheckResult, near

NAME: Final = "flexible"
DEFLECTIONS: Final = (0.02, 0.03, 0.035)
"""Around that under a quarter of a HMMWV, 0.027 [m]."""
CONVERGED: Final = (4900.0, 8011.0, 9565.0)
"""Loads of the same tire of 90 x 16 cells at them [N]."""
CLEARANCE: Final = 0.002
"""Between tire and road at the start [m]."""


def pressed_tire(device: str = "cpu") -> list[CheckResult]:
    """The HMMWV's tire of 45 x 8 cells at 2.4 bar. Nodes alone touch, 65 mm apart, so that the load swings by 2 % with
    the turn of the wheel; the mesh itself leaves 7 %, less of the stiffness.
    """
    tire = with_options(load_vehicle("hmmwv"), tire="flexible").axles[0].tire
    shell = TireShell(tire)
    builder = ModelBuilder()
    builder.add_shape_plane(material=Material(friction=shell.values.friction))
    height = tire.radius + 0.5 * shell.values.thickness + CLEARANCE
    rim = builder.add_body("rim", mass=50.0, inertia=(1.0, 1.0, 1.0), pose=pose((0.0, 0.0, height)))
    drive = PositionDrive(stiffness=1e9, damping=1e6)
    builder.add_joint_prismatic("press", WORLD, rim, axis=(0.0, 0.0, 1.0), drive=drive)
    mesh = shell.add(builder, "tire", rim, pose((0.0, 0.0, height)))
    sim = Simulation(builder.finalize(1, device), 1e-3, flex=Options(numerical_damping=1.0))
    nodes = [mesh.bodies[node] for node in mesh.nodes]
    loads, start = [], 0.0
    for deflection in DEFLECTIONS:
        goal = -CLEARANCE - deflection
        for share in np.linspace(0.02, 1.0, 50):
            sim.control.joint_target_q.assign(np.array([[start + share * (goal - start)]], np.float32))
            sim.step(2)
        sim.step(250)
        loads.append(float(sim.contacts.body_contact_force.numpy()[0, nodes, 2].sum()))
        start = goal
    stiffness, fine = ((each[2] - each[0]) / (DEFLECTIONS[2] - DEFLECTIONS[0]) for each in (loads, CONVERGED))
    title = "tire of 45 x 8 cells"
    return [
        near(NAME, f"{title}: load at 30 mm [N]", CONVERGED[1], loads[1], 0.12 * CONVERGED[1]),
        near(NAME, f"{title}: stiffness from 20 to 35 mm [N/m]", fine, stiffness, 0.1 * fine),
    ]
