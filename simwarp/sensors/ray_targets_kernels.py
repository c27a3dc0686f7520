"""The table of what rays can hit beside the shapes of a scene, and the functions that are made from it.

A new target is one row here; its functions stand beside its feature. Views are arrays of one struct, so that a target
may come after the sensors, and rays of a scene without it carry along a pointer and one test.
"""

import linecache
from typing import Any, Final

import warp as wp

from simwarp.sensors.ray_hit_kernels import RayHit, RayTarget, TargetExtent
from simwarp.soil.soil_rays_kernels import SOIL_TARGET

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

TARGETS: Final[tuple[RayTarget, ...]] = (SOIL_TARGET,)

RayTargets: Any = wp.struct(
    type(
        "RayTargets", (), {
            "__doc__": "Views of the targets of a scene, (1,) each.", "__module__": __name__,
            "__annotations__": {target.name: wp.array(dtype=target.view) for target in TARGETS},
        },
    )
)  # fmt: skip


def _function(name: str, head: str, lines: list[str]) -> Any:
    """A device function of a text, from which Warp compiles it."""
    source = "\n".join([f"def {name}({head}):", *(f"    {line}" for line in lines), ""])
    file = f"<{__name__}.{name}>"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    scope: dict[str, Any] = {
        "wp": wp, "RayHit": RayHit, "RayTargets": RayTargets, "TargetExtent": TargetExtent, "__name__": __name__,
        **{f"{target.name}_{part}": getattr(target, part) for target in TARGETS for part in ("ray", "extent")},
    }  # fmt: skip
    exec(compile(source, file, "exec"), scope)
    return wp.func(scope[name])


_RAY: Final = "world: int, start: wp.vec3, direction: wp.vec3, reach: float, targets: RayTargets"

target_extent = _function(
    "target_extent", "world: int, kind: int, targets: RayTargets",
    [
        "extent = TargetExtent()", "extent.kind = kind",
        *(f"if kind == {each.kind}:\n        extent = {each.name}_extent(world, targets.{each.name})"
          for each in TARGETS),
        "return extent",
    ],
)  # fmt: skip
"""Extent of an instance, which is that of its shape where its kind is none of a target's."""

targets_ray = _function(
    "targets_ray", _RAY,
    [
        "best = RayHit()", "best.t = -1.0", "limit = float(reach)",
        *(f"if targets.{each.name}[0].instances > 0:\n"
          f"        hit = {each.name}_ray(world, start, direction, limit, targets.{each.name})\n"
          "        if hit.t >= 0.0 and (best.t < 0.0 or hit.t < best.t):\n"
          "            best = hit\n"
          "            limit = hit.t"
          for each in TARGETS),
        "return best",
    ],
)  # fmt: skip
"""The nearest hit of a ray with a target, within reach [m]."""
