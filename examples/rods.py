"""Rods at work: a crane that lifts a load on a cable, a rope over a pulley, a leaf spring, a flexible pendulum.

python examples/rods.py --plot rods.png
"""

import argparse
from pathlib import Path

import numpy as np

import simwarp as sw

STEEL = sw.flex.Elastic(young=2.1e11, density=7850.0, damping_time=0.01)
HEMP = sw.flex.Elastic(young=1.0e8, poisson=0.3, density=1000.0, damping_time=1e-2)


def crane(builder: sw.ModelBuilder, x: float) -> int:
    """A trolley on a rail pulls a load of 100 kg on a steel cable of 4 mm; returns the load."""
    trolley = builder.add_body("trolley", mass=20.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((x, 0.0, 3.0)))
    builder.add_joint_prismatic(
        "rail", sw.WORLD, trolley, axis=(0.0, 1.0, 0.0),
        drive=sw.PrescribedPosition(table=([0.0, 1.5, 10.0], [0.0, 1.0, 1.0])),
    )  # fmt: skip
    cable = builder.add_rod(
        "cable", [(x, 0.0, 3.0), (x, 0.0, 1.0)], elements=12, section=sw.flex.Round(diameter=0.004), material=STEEL,
        start=sw.flex.Hinge("trolley"),
    )  # fmt: skip
    load = builder.add_body("load", mass=100.0, inertia=(2.0, 2.0, 2.0), pose=sw.pose((x, 0.0, 0.85)))
    builder.add_shape_box(load, half=(0.15, 0.15, 0.15))
    builder.add_joint_fixed("hook", cable.bodies[-1], load, anchor=(x, 0.0, 1.0))
    return load


def pulley(builder: sw.ModelBuilder, x: float) -> sw.flex.Rod:
    """A rope lies over a fixed drum of 10 cm, with 2 kg at one end and 3 kg at the other: friction holds it."""
    drum = 0.11  # to the middle of the rope
    turn = np.linspace(np.pi, 0.0, 17)
    over = np.stack([np.full(17, x), drum * np.cos(turn), 2.0 + drum * np.sin(turn)], axis=1)
    down = np.linspace(0.8, 0.0, 10)[:, None] * [0.0, 0.0, -1.0]
    points = np.concatenate([over[0] + down[:-1], over, over[-1] + down[::-1][1:]])
    builder.add_shape_cylinder(
        sw.WORLD, radius=0.1, half_length=0.1, material=sw.Material(friction=0.5),
        pose=sw.pose((x, 0.0, 2.0), (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))),
    )  # fmt: skip
    rope = builder.add_rod(
        "rope", points, section=sw.flex.Round(diameter=0.02), material=HEMP, surface=sw.Material(friction=0.5)
    )
    for name, end, mass in (("light", 0, 2.0), ("heavy", -1, 3.0)):
        weight = builder.add_body(name, mass=mass, inertia=(0.01,) * 3, pose=sw.pose(points[end]))
        builder.add_joint_fixed(f"{name}_knot", rope.bodies[end], weight)
    return rope


def leaf_spring(builder: sw.ModelBuilder, x: float) -> int:
    """A leaf of steel on a hinge and a shackle carries 100 kg in its middle; returns the load."""
    along = np.linspace(-0.6, 0.6, 13)
    points = np.stack([np.full(13, x), along, 1.0 + 0.15 * (along / 0.6) ** 2], axis=1)
    leaf = builder.add_rod(
        "leaf", points, section=sw.flex.Rectangle(width=0.06, height=0.008), material=STEEL,
        start=sw.flex.Hinge(axis=(1.0, 0.0, 0.0)),
    )  # fmt: skip
    shackle = builder.add_body("shackle", mass=1.5, inertia=(3e-3,) * 3, pose=sw.pose((x, 0.6, 1.2)))
    builder.add_joint_revolute("eye", shackle, leaf.bodies[-1], axis=(1.0, 0.0, 0.0), anchor=(x, 0.6, 1.15))
    builder.add_joint_revolute("hanger", sw.WORLD, shackle, axis=(1.0, 0.0, 0.0), anchor=(x, 0.6, 1.25))
    load = builder.add_body("axle", mass=100.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((x, 0.0, 1.0)))
    builder.add_shape_box(load, half=(0.1, 0.1, 0.1))
    builder.add_joint_fixed("seat", leaf.bodies[6], load)
    return load


def main() -> None:
    """Runs all of them in one world for two seconds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--plot", type=Path, default=None, help="picture of the rods over time")
    arguments = parser.parse_args()
    builder = sw.ModelBuilder()
    load, rope, axle = crane(builder, 0.0), pulley(builder, 1.0), leaf_spring(builder, 2.0)
    pendulum = builder.add_rod(
        "pendulum", [(3.0, 0.0, 2.0), (3.0, 1.0, 2.0)], elements=20, section=sw.flex.Round(diameter=0.02),
        material=sw.flex.Elastic(young=1e6, poisson=0.45, density=1000.0), start=sw.flex.Hinge(),
    )  # fmt: skip
    sim = sw.Simulation(builder.finalize(1, "cpu"), 0.001, joint_reactions=True)
    shapes = []
    for _ in range(round(arguments.seconds / 0.1)):
        sim.step(100)
        shapes.append(sim.state.body_x.numpy()[0].copy())
    place = sim.body_position(load)
    print(f"the load has moved by {place[1]:.2f} m and hangs {3.0 - place[2]:.2f} m below the trolley")
    tension = sw.flex.rod_forces(sim, rope).numpy()[0, [0, -1], 0]
    print(f"the rope pulls with {tension[0]:.0f} N and {tension[1]:.0f} N at its ends: friction takes the rest")
    print(f"the leaf spring has sunk by {1000.0 * (1.0 - sim.body_position(axle)[2]):.0f} mm")
    print(f"the tip of the pendulum is at {sim.body_position(pendulum.bodies[-1])[1:].round(2)}")
    if arguments.plot is not None:
        draw(arguments.plot, sim, shapes)


def draw(path: Path, sim: sw.Simulation, shapes: list[np.ndarray]) -> None:
    """Bodies of each rod, seen along x, from the first moment (light) to the last."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 4, figsize=(13, 4))
    for place, (axis, name) in enumerate(zip(axes, ("cable", "rope", "leaf", "pendulum"), strict=True)):
        nodes = [index for index, body in enumerate(sim.model.body_names) if body.startswith(f"{name}_")]
        for moment, shape in enumerate(shapes):
            shade = 0.85 - 0.85 * (moment + 1) / len(shapes)
            axis.plot(shape[nodes, 1], shape[nodes, 2], color=str(shade), lw=1.0)
        axis.set_title(name)
        axis.set_aspect("equal", "datalim")
        axis.set_xlabel("y [m]")
        if place == 0:
            axis.set_ylabel("z [m]")
    figure.tight_layout()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
