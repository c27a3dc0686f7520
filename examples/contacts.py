"""A wall of bricks, and a ball that breaks it: shapes, materials, contact forces, and what to do about overflow."""

import numpy as np

import simwarp as sw

WORLDS = 4

builder = sw.ModelBuilder()
ground = sw.Material(friction=0.6)
builder.add_shape_plane(material=ground, name="ground")
for row in range(3):
    for column in range(4 - row):
        at = sw.pose((0.0, 0.4 * column + 0.2 * row, 0.1 + 0.2 * row))
        builder.add_solid(f"brick{row}_{column}", "box", (0.1, 0.2, 0.1), density=500.0, pose=at, material=ground)
ball = builder.add_solid(
    "ball", "sphere", 0.15, mass=20.0, pose=sw.pose((-2.0, 0.6, 0.4)), material=sw.Material(friction=0.4)
)
# every world gets its own speed of the ball and its own friction of the ground
model = builder.finalize(WORLDS, "cpu", per_world=["shape_friction"])
friction = model.shape_friction.numpy()
friction[:, 0] = np.linspace(0.2, 0.8, WORLDS)
model.shape_friction.assign(friction)
sim = sw.Simulation(model, dt=5e-3)
velocity = sim.state.body_v.numpy()
velocity[:, ball, 0] = np.linspace(2.0, 8.0, WORLDS)
sim.state.body_v.assign(velocity)

for step in range(200):
    sim.step()
    if step % 50 == 49:
        count = sim.contacts.contact_count.numpy()
        residual = sim.diagnostics.cone_residual.numpy().max()
        print(f"t {sim.dt * (step + 1):.2f} s: contacts {count}, residual {residual:.1e} m/s")

top = sim.state.body_x.numpy()[:, :ball, 2].max(axis=1)
weight = sim.contacts.shape_contact_force.numpy()[:, 0, 2]
for world in range(WORLDS):
    print(f"world {world}: highest brick at {top[world]:.2f} m, the ground carries {-weight[world]:.0f} N")
for line in sim.problems():
    print(line)
