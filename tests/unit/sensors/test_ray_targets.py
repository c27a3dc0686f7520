"""What rays can hit beside shapes is a row of a table: here one more, a level plane, beside the soil."""

# The kernels are Warp's language, as those in simwarp/kernels.
# mypy: disable-error-code="index, operator, assignment, valid-type, name-defined"

import ast
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

import simwarp.sensors
from simwarp.core.types import ShapeType
from simwarp.sensors.ray_hit_kernels import RayHit, RayTarget, TargetExtent
from simwarp.sensors.ray_targets_kernels import TARGETS, target_functions


@wp.struct
class LevelView:
    """A plane z = height."""

    instances: int
    height: float


@wp.func
def level_extent(world: int, view: wp.array[LevelView]):
    extent = TargetExtent()
    extent.kind = 5
    extent.above = view[0].height
    return extent


@wp.func
def level_ray(world: int, start: wp.vec3, direction: wp.vec3, reach: float, view: wp.array[LevelView]):
    hit = RayHit()
    hit.t = (view[0].height - start[2]) / direction[2]
    if hit.t < 0.0 or hit.t > reach:
        hit.t = -1.0
    hit.instance = view[0].instances
    return hit


LOW = RayTarget(name="low", kind=70, view=LevelView, extent=level_extent, ray=level_ray)
HIGH = RayTarget(name="high", kind=71, view=LevelView, extent=level_extent, ray=level_ray)
Views, extent_of, nearest = target_functions((LOW, HIGH), __name__)


@wp.kernel(enable_backward=False, module="unique")
def cast(
    start: wp.array[wp.vec3], direction: wp.array[wp.vec3], reach: float, views: Views, t: wp.array[float],
    instance: wp.array[int], above: wp.array[float],
):  # fmt: skip
    ray = wp.tid()
    hit = nearest(0, start[ray], direction[ray], reach, views)
    t[ray] = hit.t
    instance[ray] = hit.instance
    above[ray] = extent_of(0, 69 + ray, views).above


def view(instances: int, height: float) -> wp.array:
    level: Any = LevelView()
    level.instances, level.height = instances, height
    return wp.array([level], dtype=LevelView, device="cpu")


def test_a_ray_meets_the_nearest_of_several_targets():
    down, up = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
    start: Any = wp.array([(0.0, 0.0, 5.0), (0.0, 0.0, 2.0), (0.0, 0.0, 0.0)], dtype=wp.vec3, device="cpu")
    direction: Any = wp.array([down, down, up], dtype=wp.vec3, device="cpu")
    found: list[Any] = [wp.zeros(3, dtype=dtype, device="cpu") for dtype in (float, int, float)]
    for high, distances, instances in ((2, (2.0, 1.0, 1.0), (2, 1, 1)), (0, (4.0, 1.0, 1.0), (1, 1, 1))):
        views: Any = Views()
        views.low, views.high = view(1, 1.0), view(high, 3.0)
        wp.launch(cast, 3, inputs=[start, direction, 10.0, views], outputs=found, device="cpu")
        assert found[0].numpy().tolist() == list(distances)
        assert found[1].numpy().tolist() == list(instances)
        assert found[2].numpy().tolist() == [0.0, 1.0, 3.0]  # of a kind that is none, and of both
    wp.launch(cast, 3, inputs=[start, direction, 0.5, views], outputs=found, device="cpu")
    assert (found[0].numpy() == -1.0).all()


def test_kinds_and_names_are_their_own():
    assert len({target.name for target in TARGETS}) == len({target.kind for target in TARGETS}) == len(TARGETS)
    assert not {target.kind for target in TARGETS} & {int(kind) for kind in ShapeType}
    for target in TARGETS:
        assert np.isin(["instances"], list(target.view.vars)).all()


def test_casts_of_rays_know_no_feature():
    folder = Path(simwarp.sensors.__file__).parent
    for name in ("ray_casting_kernels", "ray_instances_kernels", "ray_hit_kernels"):
        tree = ast.parse((folder / f"{name}.py").read_text(encoding="utf-8"))
        found = {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert not [module for module in found if module.split(".")[1:2] in (["soil"], ["vehicle"], ["flex"])]
