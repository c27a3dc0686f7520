"""Visuals: a picture of a thing together with the simple shapes that stand for it in contact."""

from __future__ import annotations

import dataclasses
import math
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import quat_multiply, rotate
from simwarp.core.types import WORLD, ModelError, Pose, ShapeType, pose
from simwarp.geometry.visual_mesh import VisualMesh, joined
from simwarp.scenery.solids import icosphere, moved

if TYPE_CHECKING:
    from simwarp.model.builder import ModelBuilder
    from simwarp.model.keyword_argument_types import SurfaceOptions
    from simwarp.sensors.instances import AppearanceOptions
    from simwarp.sensors.scene import Visuals

Array = npt.NDArray[np.float64]

ROUND_CORNERS = 12
"""Of the polygon that stands for a circle in a hull."""


class Label(IntEnum):
    """Semantic classes of scenery; 0 is anything else."""

    GROUND = 1
    ROAD = 2
    ROCK = 3
    BUSH = 4
    TREE = 5
    CONE = 6
    PILLAR = 7
    BARRIER = 8
    CRATE = 9
    WALL = 10
    VEHICLE = 11


@dataclasses.dataclass(frozen=True, kw_only=True)
class Proxy:
    """One shape that contact sees in place of a picture.

    Attributes:
        kind: BOX, CYLINDER, CONE, SPHERE, ELLIPSOID, HULL or MESH.
        size: as `ShapeType` tells [m]; unused by HULL and MESH.
        pose: of the shape's frame in that of the visual.
        points: (N, 3) of a HULL or MESH, in the shape's frame [m].
        triangles: (T, 3) of a MESH.
    """

    kind: ShapeType
    size: tuple[float, float, float] = (1.0, 1.0, 1.0)
    pose: Pose = dataclasses.field(default_factory=pose)
    points: Array | None = None
    triangles: npt.NDArray[np.int64] | None = None

    def corners(self) -> Array:
        """(N, 3) points of its surface in the visual's frame, whose hull is the shape, or near it where it is round."""
        angle = 2.0 * math.pi * np.arange(ROUND_CORNERS) / ROUND_CORNERS
        rim = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
        up = np.array([0.0, 0.0, 1.0])
        if self.points is not None:
            local = self.points
        elif self.kind == ShapeType.BOX:
            local = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * self.size
        elif self.kind == ShapeType.CYLINDER:
            local = np.concatenate([rim + up, rim - up]) * np.array([self.size[0], self.size[0], self.size[1]])
        elif self.kind == ShapeType.CONE:
            local = np.concatenate([rim - up, up[None]]) * np.array([self.size[0], self.size[0], self.size[1]])
        else:
            local = icosphere(1)[0] * self.size
        return self.pose.position + rotate_all(self.pose.rotation, local)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Visual:
    """A thing of the scenery, in its own frame: Z up, origin in the middle of its foot.

    Attributes:
        name: of the kind of thing.
        mesh: its visual.
        proxies: collision shapes; the first one is what stands in a vehicle's way.
        label: semantic class.
        reflectance: of a lidar's or radar's beam, 0 to 1.
    """

    name: str
    mesh: VisualMesh
    proxies: tuple[Proxy, ...]
    label: Label
    reflectance: float = 0.5

    @property
    def lower(self) -> Array:
        """(3,) lowest corner of the box around the visual [m]."""
        return np.asarray(self.mesh.vertices.min(axis=0))

    @property
    def upper(self) -> Array:
        """(3,) highest corner of the box around the visual [m]."""
        return np.asarray(self.mesh.vertices.max(axis=0))

    @property
    def radius(self) -> float:
        """Radius of the upright cylinder about the origin that holds all its proxies: what to keep clear of [m]."""
        return max(float(np.linalg.norm(proxy.corners()[:, :2], axis=1).max()) for proxy in self.proxies)

    @property
    def hull(self) -> Array:
        """(N, 3) points [m] whose hull is the first proxy: an asset for slots that show one visual or another."""
        return self.proxies[0].corners()


def arranged(visual: Visual, places: npt.ArrayLike) -> Visual:
    """Copies of a visual as one: a row of cones costs a camera one instance, not one for each.

    Args:
        visual: original of the copy.
        places: (n, 3) x, y [m] and yaw [rad] on level ground, as `Track.marks`, `beside` and `scattered` give them.

    Raises:
        ModelError: there is no place, or one is not finite.
    """
    rows = np.asarray(places, dtype=np.float64).reshape(-1, 3)
    if not len(rows) or not np.isfinite(rows).all():
        raise ModelError(f"arranged: places must be (n >= 1, 3) finite numbers, got {places!r}; pass x, y and yaw")
    proxies = []
    for x, y, yaw in rows:
        frame = yaw_pose(x, y, 0.0, yaw)
        for proxy in visual.proxies:
            place = pose(
                frame.position + rotate(frame.rotation, proxy.pose.position),
                quat_multiply(frame.rotation, proxy.pose.rotation),
            )
            proxies.append(dataclasses.replace(proxy, pose=place))
    mesh = joined([moved(visual.mesh, (x, y, 0.0), yaw=yaw) for x, y, yaw in rows.tolist()])
    return dataclasses.replace(visual, mesh=mesh, proxies=tuple(proxies))


def rotate_all(rotation: Array, points: Array) -> Array:
    """(N, 3) points turned by a quaternion xyzw."""
    t = 2.0 * np.cross(rotation[:3], points)
    return np.asarray(points + rotation[3] * t + np.cross(rotation[:3], t))


def yaw_pose(x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Pose:
    """A pose at (x, y, z) [m], turned by `yaw` about z [rad]."""
    return pose((x, y, z), (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)))


def add_collision(
    builder: ModelBuilder, visual: Visual, *, name: str, at: Pose | None = None, body: int = WORLD, scale: float = 1.0,
    **options: Unpack[SurfaceOptions],
) -> list[int]:  # fmt: skip
    """Adds the proxies of a visual as shapes; returns their indices.

    Args:
        builder: of the world.
        visual: visual to add.
        name: of the shapes, with a number after it where there are several.
        at: frame of the visual on the body (from its centre of mass), or in the world.
        body: index, or WORLD.
        scale: factor of the visual's size.
        options: `material`, `margin`, `group`, `mask` of the shapes.
    """
    frame = pose() if at is None else at
    shapes = []
    for index, proxy in enumerate(visual.proxies):
        place = pose(
            frame.position + rotate(frame.rotation, scale * proxy.pose.position),
            quat_multiply(frame.rotation, proxy.pose.rotation),
        )
        title = name if len(visual.proxies) == 1 else f"{name}_{index}"
        shapes.append(_add_shape(builder, proxy, body, scale, {"name": title, "pose": place, **options}))
    return shapes


def _add_shape(builder: ModelBuilder, proxy: Proxy, body: int, scale: float, options: dict[str, Any]) -> int:
    a, b, c = (scale * value for value in proxy.size)
    if proxy.kind == ShapeType.BOX:
        return builder.add_shape_box(body, half=(a, b, c), **options)
    if proxy.kind == ShapeType.CYLINDER:
        return builder.add_shape_cylinder(body, radius=a, half_length=b, **options)
    if proxy.kind == ShapeType.CONE:
        return builder.add_shape_cone(body, radius=a, half_length=b, **options)
    if proxy.kind == ShapeType.ELLIPSOID:
        return builder.add_shape_ellipsoid(body, half=(a, b, c), **options)
    assert proxy.points is not None
    if proxy.kind == ShapeType.HULL:
        return builder.add_shape_hull(body, proxy.points, scale=(scale,) * 3, **options)
    shape = builder.add_shape_mesh(body, proxy.points, proxy.triangles, scale=(scale,) * 3, **options)
    assert isinstance(shape, int)
    return shape


def add_visual(
    visuals: Visuals, visual: Visual, *, name: str, at: Pose | None = None, body: int = WORLD, scale: float = 1.0,
    shapes: list[int] | tuple[int, ...] = (), **appearance: Unpack[AppearanceOptions],
) -> int:  # fmt: skip
    """Adds the picture of a visual; returns the instance, whose index later calls of `Visuals.hide` change.

    Args:
        visuals: of the world.
        visual: visual to add.
        name: of the instance.
        at: as in `add_collision`.
        body: index, or WORLD.
        scale: factor of the visual's size.
        shapes: its proxies in contact, which are hidden.
        appearance: fields of `Appearance`; label and reflectance are the visual's unless given.
    """
    visuals.hide(*shapes)
    own: AppearanceOptions = {"label": int(visual.label), "reflectance": visual.reflectance}
    return visuals.add_mesh(
        body, visual.mesh, name=name, pose=at, scale=(scale,) * 3, **(own | appearance)
    )  # fmt: skip
