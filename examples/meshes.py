"""Flexible meshes at work: a cloth falls over a ball, a ball of foam is pressed flat, a beam hangs from a wall.

python examples/meshes.py --picture meshes.png
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image

import simwarp as sw
from simwarp.sensors import CameraConfig, CheckerTexture, Lighting, Pinhole, Sun, Visuals, look_at
from simwarp.viewer import FreeCamera, grid

CLOTH = sw.flex.Elastic(young=1e6, poisson=0.3, density=500.0, damping_time=5e-3)
RUBBER = sw.flex.Rubber(young=2.5e5, poisson=0.4, density=1000.0, damping_time=5e-3)
FOAM = sw.flex.Rubber(young=4e4, poisson=0.2, density=300.0, damping_time=2e-2)
SURFACE = sw.Material(friction=0.5)
MOST = (2e4, 5e3, 2e4)
"""Stress of the last colour of cloth, ball and beam [Pa]."""


def cloth(builder: sw.ModelBuilder, x: float, cells: int = 12) -> sw.flex.FlexibleMesh:
    """A square of 0.8 m above a fixed ball; diagonals of its triangles all go one way."""
    builder.add_shape_sphere(sw.WORLD, radius=0.22, pose=sw.pose((x, 0.0, 0.35)), material=SURFACE, name="stand")
    line = np.linspace(-0.4, 0.4, cells + 1)
    across, along = np.meshgrid(line, line, indexing="ij")
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1)
    beside = corner + cells + 1
    halves = [np.stack([corner, beside, beside + 1], 1), np.stack([corner, beside + 1, corner + 1], 1)]
    return builder.add_shell(
        "cloth", np.stack([across, along, np.zeros_like(across)], axis=-1).reshape(-1, 3), np.concatenate(halves),
        thickness=2e-3, material=CLOTH, pose=sw.pose((x, 0.0, 0.62)), radius=0.01, surface=SURFACE,
    )  # fmt: skip


def ball(builder: sw.ModelBuilder, x: float) -> sw.flex.FlexibleMesh:
    """A ball in a lattice of hexahedra, whose own round surface is seen, under a plate of 20 kg that a rail leads."""
    round_one = trimesh.creation.icosphere(subdivisions=4, radius=0.2)
    solid = sw.flex.lattice((round_one.vertices, round_one.faces), spacing=0.08)
    mesh = builder.add_solid_mesh(
        "ball", solid, material=FOAM, pose=sw.pose((x, 0.0, 0.23)), radius=2e-3, surface=SURFACE
    )
    plate = builder.add_body("plate", mass=20.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((x, 0.0, 0.55)))
    builder.add_shape_box(plate, half=(0.25, 0.25, 0.03), material=SURFACE)
    builder.add_joint_prismatic("rail", sw.WORLD, plate, axis=(0.0, 0.0, 1.0))
    return mesh


def beam(builder: sw.ModelBuilder, x: float) -> sw.flex.FlexibleMesh:
    """A rubber beam that bends under its own weight."""
    solid = sw.flex.box((0.08, 0.8, 0.08), (2, 12, 2))
    return builder.add_solid_mesh("beam", solid, material=RUBBER, pose=sw.pose((x, 0.0, 0.7)), fixed="y_max")


def main() -> None:
    """Runs all of them in one world, and takes pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=1.2)
    parser.add_argument("--picture", type=Path, default=None, help="PNG: start, end, end in colours of stress")
    arguments = parser.parse_args()
    builder = sw.ModelBuilder()
    ground = builder.add_shape_plane(material=SURFACE)
    meshes = cloth(builder, -0.9), ball(builder, 0.0), beam(builder, 0.7)
    plain, colored = Visuals(builder), Visuals(builder)
    for mesh, color in zip(meshes, ((0.75, 0.16, 0.05), (0.06, 0.3, 0.55), (0.08, 0.4, 0.2)), strict=True):
        plain.show(mesh, color=color)
        colored.show_values(mesh)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 0.001)
    lighting = Lighting(suns=(Sun(direction=(0.3, -0.8, 1.5)),))
    config = CameraConfig(width=480, height=300, samples=3, lens=Pinhole(fov=0.8))
    cameras = []
    for visuals in (plain, colored):
        squares = CheckerTexture(colors=((0.21, 0.225, 0.24), (0.25, 0.265, 0.28)), metres=0.25)
        visuals.show(ground, color=(1.0, 1.0, 1.0), texture=visuals.texture(squares))
        cameras.append(FreeCamera(visuals.finalize(sim.model), [0], config, lighting))
    eye = look_at((-0.05, -2.9, 1.1), (-0.12, 0.0, 0.3))
    pictures: list[Any] = [cameras[0].render(sim.state, [eye])[0]]
    sim.step(round(arguments.seconds / 0.001))
    for mesh, most in zip(meshes, MOST, strict=True):
        cameras[1].scene.set_values(mesh, sw.flex.mesh_stress(sim, mesh), most=most)
    pictures += [camera.render(sim.state, [eye])[0] for camera in cameras]
    places = [sw.flex.mesh_positions(sim, mesh).numpy()[0] for mesh in meshes]
    print(f"the cloth reaches down to {places[0][:, 2].min():.2f} m")
    print(f"the ball is {np.ptp(places[1][:, 2]):.2f} m high and {np.ptp(places[1][:, 0]):.2f} m wide, cells and all")
    print(f"the beam's end hangs {0.7 - places[2][:, 2].min():.2f} m below the wall")
    if arguments.picture is not None:
        Image.fromarray(grid(pictures, 3)).save(arguments.picture)


if __name__ == "__main__":
    main()
