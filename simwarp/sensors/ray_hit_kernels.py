"""What a ray brings back, and what a feature gives so that rays can hit what it deforms."""

import dataclasses
from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class RayHit:
    """Hit of a ray in a scene."""

    t: float  # distance along the unit direction [m]; -1: nothing
    normal: wp.vec3  # unit, world axes, on the outer side of the surface
    instance: int  # -1: nothing
    triangle: int  # of a mesh, hull or height field; -1: a primitive
    bary: wp.vec2  # weights of the triangle's corners 1 and 2
    local: wp.vec3  # the point in the instance's own frame, before its scale
    drop: float  # of soil: how far the point was pressed down [m]; else 0


@wp.struct
class TargetExtent:
    """Bounds of a target: those of the shape that it deforms, and how far it reaches beyond."""

    kind: int  # ShapeType
    above: float  # [m]
    below: float  # [m]


@dataclasses.dataclass(frozen=True, kw_only=True)
class RayTarget:
    """Something that rays can hit beside the shapes of a scene, such as the surface of a soil.

    It takes the place of one instance of the scene, whose kind becomes `kind`. Its functions stand beside its feature;
    `ray_targets_kernels.py` calls those of all targets.

    Attributes:
        name: of its view in `RayTargets`.
        kind: of its instance: a number that no `ShapeType` has.
        view: struct of all that its functions read. Its member `instances` is 0 where a scene has no such target.
        extent: device function of the world and the (1,) array of the view; returns a `TargetExtent`.
        ray: device function of world, start (as of `start_of_ray`), unit direction, reach [m] and the array of the
            view; returns a `RayHit`.
    """

    name: str
    kind: int
    view: Any
    extent: Any
    ray: Any
