"""Rough ground for robots on legs: patches of all kinds, from easy to hard, each coloured by its level.

Every patch is 8 m x 8 m. They are assets of one model, in which each world shows another one.

Run: python examples/rough_ground.py --plot rough_ground.png
"""

from __future__ import annotations

import argparse
import itertools

import numpy as np
from PIL import Image

import simwarp as sw
from simwarp.scenery import LEVELS, GroundKind, ground_patch, level_colors
from simwarp.sensors import CameraConfig, CheckerTexture, Lighting, Pinhole, Sun, Visuals, look_at
from simwarp.viewer import FreeCamera, caption, grid

SIDE = 8.0


def pictures(levels: list[int], width: int, seed: int = 0) -> list[np.ndarray]:
    """A picture of every kind on every level, kind by kind: (2/3 width, width, 3) each."""
    shown = list(itertools.product(GroundKind, levels))
    builder = sw.ModelBuilder()
    # a body far below: models have at least one
    builder.add_body("nobody", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 0.0, -1e3)))
    fields = [ground_patch(kind, level, seed) for kind, level in shown]
    assets = [builder.add_height_field_asset(field, size=(SIDE, SIDE)) for field in fields]
    ground = builder.add_shape_height_field(sw.WORLD, fields[0], size=(SIDE, SIDE), name="ground")
    visuals = Visuals(builder)
    checker = CheckerTexture(colors=((0.72, 0.72, 0.72), (1.0, 1.0, 1.0)), metres=0.5)
    visuals.show(ground, color=(1.0, 1.0, 1.0), texture=visuals.texture(checker))
    model = builder.finalize(len(shown), "cpu", per_world=("shape_asset",))
    scene = visuals.finalize(model, per_world=("color",), origin_body=sw.WORLD)
    model.shape_asset.assign(np.array(assets, np.int32)[:, None])
    scene.color.assign(level_colors()[[level for _, level in shown], None].astype(np.float32))
    config = CameraConfig(width=width, height=2 * width // 3, lens=Pinhole(fov=0.75), samples=3, far=100.0)
    lighting = Lighting(suns=(Sun(direction=(-0.35, -0.8, 0.5)),), shadow_reach=30.0)
    camera = FreeCamera(scene, list(range(len(shown))), config, lighting)
    view = look_at((-9.4, -6.5, 8.3), (-0.2, -0.2, -0.3))
    return list(camera.render(sw.Simulation(model, 1e-3).state, [view] * len(shown)))


def main(arguments: list[str] | None = None) -> None:
    """Take the pictures and put them onto one sheet."""
    parser = argparse.ArgumentParser(description="Rough ground of every kind, from easy to hard.")
    parser.add_argument("--width", type=int, default=240, help="of one picture [pixels]")
    parser.add_argument("--seed", type=int, default=0, help="of what is random")
    parser.add_argument("--levels", type=int, nargs="+", default=[0, 3, 6, 9], help=f"of difficulty, below {LEVELS}")
    parser.add_argument("--plot", default="rough_ground.png", help="file of the sheet")
    options = parser.parse_args(arguments)
    found = pictures(options.levels, options.width, options.seed)
    size = max(8, options.width // 16)
    titled = [
        caption(picture, f"{kind.value.replace('_', ' ')}, level {level}", size=size)
        for picture, (kind, level) in zip(found, itertools.product(GroundKind, options.levels), strict=True)
    ]
    Image.fromarray(grid(titled, 2 * len(options.levels))).save(options.plot)
    print(f"{len(found)} patches: {options.plot}")


if __name__ == "__main__":
    main()
