"""The table of what rays can hit beside the shapes of a scene, and the functions that are made from it.

A new target is one row here; its functions stand beside its feature. Views are arrays of one struct, so that a target
may come after the sensors, and rays of a scene without it carry along a pointer and one test.
"""

import linecache
from collections.abc import Sequence
from typing import Any, Final

import warp as wp

from simwarp.sensors.ray_hit_kernels import RayHit, RayTarget, TargetExtent
from simwarp.soil.soil_rays_kernels import SOIL_TARGET

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

TARGETS: Final[tuple[RayTarget, ...]] = (SOIL_TARGET,)

EXTENT: Final = """\
def target_extent(world: int, kind: int, targets: RayTargets):
    extent = TargetExtent()
    extent.kind = kind
{}    return extent
"""
EXTENT_OF_ONE: Final = """\
    if kind == {kind}:
        extent = {name}_extent(world, targets.{name})
"""
RAY: Final = """\
def targets_ray(world: int, start: wp.vec3, direction: wp.vec3, reach: float, targets: RayTargets):
    best = RayHit()
    best.t = -1.0
    limit = float(reach)
{}    return best
"""
RAY_OF_ONE: Final = """\
    if targets.{name}[0].instances > 0:
        {name}_hit = {name}_ray(world, start, direction, limit, targets.{name})
        if {name}_hit.t >= 0.0:
            best = {name}_hit
            limit = {name}_hit.t
"""


def target_functions(targets: Sequence[RayTarget], module: str) -> tuple[Any, Any, Any]:
    """What is made from a table of targets.

    Args:
        targets: rows of the table.
        module: that the functions belong to.

    Returns:
        The struct of their views, (1,) each; the device function of world, kind of an instance and views that returns
        its `TargetExtent`, that of its shape if it is none of the targets; and the one of a ray that returns the
        nearest `RayHit` with a target within reach [m].
    """
    hints = {target.name: wp.array(dtype=target.view) for target in targets}
    views = wp.struct(type("RayTargets", (), {"__module__": module, "__annotations__": hints}))
    scope: dict[str, Any] = {
        "wp": wp, "RayHit": RayHit, "RayTargets": views, "TargetExtent": TargetExtent, "__name__": module,
        **{f"{target.name}_{part}": getattr(target, part) for target in targets for part in ("ray", "extent")},
    }  # fmt: skip
    for name, frame, row in (("target_extent", EXTENT, EXTENT_OF_ONE), ("targets_ray", RAY, RAY_OF_ONE)):
        source = frame.format("".join(row.format(name=target.name, kind=target.kind) for target in targets))
        file = f"<{module}.{name}>"  # Warp compiles functions from their source
        linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
        exec(compile(source, file, "exec"), scope)
        scope[name] = wp.func(scope[name])
    return views, scope["target_extent"], scope["targets_ray"]


RayTargets, target_extent, targets_ray = target_functions(TARGETS, __name__)
