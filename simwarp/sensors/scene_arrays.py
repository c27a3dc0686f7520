"""Arrays of a scene: initial values of its instances, where they are placed, views of further targets."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.arrays import writable
from simwarp.geometry.assets import Hull, TriangleMesh, triangle_mesh
from simwarp.geometry.triangle_tree import NODE_WORDS, WIDTH
from simwarp.sensors.instances import Instance
from simwarp.sensors.ray_targets_kernels import TARGETS, RayTargets


def no_targets(device: Any) -> Any:
    """The views of a scene without targets of rays beside its shapes."""
    targets = RayTargets()
    for each in TARGETS:
        setattr(targets, each.name, wp.array([each.view()], dtype=each.view, device=device))
    return targets


def instance_values(instances: list[Instance]) -> dict[str, tuple[npt.NDArray[Any], Any]]:
    """One world's values and dtypes of the arrays of `PER_WORLD`."""
    return {
        "x": (np.array([each.pose.position for each in instances], np.float64).reshape(-1, 3), wp.vec3d),
        "rot": (np.array([each.pose.rotation for each in instances], np.float32).reshape(-1, 4), wp.quat),
        "size": (np.array([each.size for each in instances], np.float32).reshape(-1, 3), wp.vec3),
        "asset": (np.array([each.asset for each in instances], np.int32), wp.int32),
        "enabled": (np.ones(len(instances), np.int32), wp.int32),
        "color": (np.array([each.appearance.color for each in instances], np.float32).reshape(-1, 3), wp.vec3),
        "texture": (np.array([each.appearance.texture for each in instances], np.int32), wp.int32),
        "reflectance": (np.array([each.appearance.reflectance for each in instances], np.float32), wp.float32),
    }


def placed_arrays(count: int, world_count: int, device: Any) -> dict[str, wp.array]:
    """Output arrays of `place_instances`."""
    nodes, level = 0, max(count, 1)
    while True:
        level = -(-level // WIDTH)
        nodes += level
        if level == 1:
            break
    shape = (world_count, max(count, 1))
    arrays: dict[str, wp.array] = {
        name: writable(shape, dtype, device)
        for name, dtype in {
            "place_x": wp.vec3, "place_rot": wp.mat33, "place_size": wp.vec3, "place_asset": wp.int32,
            "lower": wp.vec3, "upper": wp.vec3, "order": wp.int32, "code": wp.int32,
        }.items()
    }  # fmt: skip
    arrays["origin"] = writable((world_count,), wp.vec3d, device)
    arrays["node"] = writable((world_count, nodes * NODE_WORDS), wp.float32, device)
    return arrays


def hull_mesh(hull: Hull) -> TriangleMesh:
    """A hull's faces as fans of triangles."""
    fans = [(face[0], face[k], face[k + 1]) for face in hull.faces for k in range(1, len(face) - 1)]
    return triangle_mesh(hull.vertices, np.array(fans))
