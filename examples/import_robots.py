"""One rod on a hinge in five formats: each reader gives the same robot, which then swings alike."""

import warnings
from pathlib import Path

import simwarp as sw

FOLDER = Path(__file__).parent / "robots"
AXIS = (0.0, 1.0, 0.0)


def rod_of_step() -> sw.importers.Imported:
    """A STEP file tells shapes and places only: masses follow from a density, joints are added by hand."""
    robot = sw.importers.load_step(FOLDER / "rod.step", density=1562.5)
    robot.builder.add_joint_revolute("hinge", sw.WORLD, robot.bodies["rod"], axis=AXIS, anchor=(0, 0, 0))
    return robot


def main() -> None:
    """Reads the files, prints what became of them, and lets the rods fall for half a second."""
    warnings.simplefilter("ignore", sw.importers.ImportedWarning)  # the reports below say the same
    robots = {
        "MJCF": sw.importers.load_mjcf(FOLDER / "rod.xml"),
        "URDF": sw.importers.load_urdf(FOLDER / "rod.urdf", base="fixed"),
        "USD": sw.importers.load_usd(FOLDER / "rod.usda"),
        "SolidWorks": sw.importers.load_solidworks(FOLDER / "rod_solidworks.py"),
        "STEP": rod_of_step(),
    }
    for name, robot in robots.items():
        simulation = sw.Simulation(robot.builder.finalize(1, "cpu"), dt=1e-3)
        simulation.step(500)
        angle = simulation.joint_position(0)
        told = f"{len(robot.report.held)} held, {len(robot.report.near)} near"
        print(f"{name:<10} {robot.mass:.4f} kg, {told}: after 0.5 s at {abs(angle):.4f} rad")


if __name__ == "__main__":
    main()
