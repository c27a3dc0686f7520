"""Three ways to drive a hinge, side by side: a PD position drive, a velocity motor, and a prescribed motion.

Each arm turns about a horizontal axis against gravity. The PD drive sags a little, the motor slips when the load
exceeds its torque, the prescribed motion is exact whatever it takes.

Run: python examples/drives.py --seconds 3
"""

from __future__ import annotations

import argparse

import numpy as np

import simwarp as sw


def add_arm(builder: sw.ModelBuilder, name: str, y: float, drive: sw.Dof) -> int:
    """A 1 kg arm along +X from a hinge about -Y, so that a positive angle lifts it. Returns the joint."""
    arm = builder.add_body(name, mass=1.0, inertia=(0.002, 0.03, 0.03), pose=sw.pose((0.3, y, 0.0)))
    return builder.add_joint_revolute(
        f"{name}_hinge", sw.WORLD, arm, axis=(0, -1, 0), anchor=(0, y, 0), armature=drive.armature, drive=drive.drive
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3.0)
    args = parser.parse_args()

    builder = sw.ModelBuilder()
    add_arm(builder, "pd", 0.0, sw.Dof(armature=0.01, drive=sw.PositionDrive(stiffness=60.0, damping=6.0)))
    add_arm(builder, "motor", 0.5, sw.Dof(drive=sw.VelocityMotor(effort_limit=2.0)))
    ramp = sw.PrescribedPosition(table=([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 1.0, 0.5]))
    add_arm(builder, "prescribed", 1.0, sw.Dof(drive=ramp))
    model = builder.finalize(world_count=1, device="cpu")
    sim = sw.Simulation(model, dt=0.002, joint_reactions=True)

    pd, motor, prescribed = (model.dof(f"{name}_hinge") for name in ("pd", "motor", "prescribed"))
    sim.control.joint_target_q[:, pd] = 1.0
    sim.control.joint_target_qd[:, motor] = 1.0

    print(f"{'time':>6}{'pd':>10}{'motor':>10}{'prescribed':>12}{'its torque':>12}")
    steps = round(args.seconds / sim.dt)
    for step in range(1, steps + 1):
        sim.step()
        if step % max(steps // 12, 1) == 0:
            q = sim.state.joint_q.numpy()[0]
            # The reaction on the arm includes the drive: its part along the hinge axis -Y is the drive torque
            torque = -sim.diagnostics.joint_reaction_torque.numpy()[0, model.joint("prescribed_hinge"), 1]
            print(f"{step * sim.dt:6.2f}{q[pd]:10.4f}{q[motor]:10.4f}{q[prescribed]:12.4f}{torque:12.3f}")
    sag = 1.0 - float(np.asarray(sim.state.joint_q.numpy())[0, pd])
    print(f"the PD drive stays {sag:.4f} rad short: gravity over stiffness")


if __name__ == "__main__":
    main()
