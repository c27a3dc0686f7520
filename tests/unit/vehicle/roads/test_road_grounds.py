"""One road for tires, soil, contact and rays: the same heights everywhere, and its maps where they belong."""

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.kernels.collision.shape import Assets
from simwarp.sensors import Visuals
from simwarp.sensors.ray_casting_kernels import closest_hit
from simwarp.sensors.ray_instances_kernels import RayScene, start_of_ray
from simwarp.soil import Soil, SoilSphere
from simwarp.vehicle.roads import RoadSurface, add_road, random_road, road_ground
from simwarp.vehicle.tires.ground_kernels import TerrainTables, friction_at, ground_below

ABOVE = 4.0
"""Of the origins of all queries [m]."""


@wp.kernel(enable_backward=False)
def look_down(
    points: wp.array[wp.vec3d], terrain: TerrainTables, scene: RayScene, assets: Assets, friction: wp.array[float],
    below_tire: wp.array[float], seen: wp.array[float], grip: wp.array[float],
):  # fmt: skip
    point = wp.tid()
    x = points[point]
    below_tire[point] = ground_below(0, x, wp.vec3(), 1.0, terrain, assets).arm[2]  # type: ignore[index]
    seen[point] = closest_hit(0, start_of_ray(0, x, scene), wp.vec3(0.0, 0.0, -1.0), 100.0, scene, assets).t  # type: ignore[index]
    grip[point] = friction_at(0, x, friction, terrain)  # type: ignore[index]


def queried(road, points, *, friction=0.9, below_soil=False):
    """Height below points as tires have it and as rays do, friction, and the heights of soil on the road [m]."""
    builder = sw.ModelBuilder()
    builder.add_body("ball", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 0.0, 50.0)))
    builder.add_shape_sphere(0, radius=0.01)
    add_road(builder, road, friction=friction, below_soil=below_soil)
    visuals = Visuals(builder)
    model = builder.finalize(1, "cpu")
    scene, simulation = visuals.finalize(model), sw.Simulation(model, 1e-3)
    terrain, tables = road_ground(model, road, friction=friction), scene.tables(0x7FFFFFFF)
    scene.place(simulation.state, tables)
    at = np.column_stack([points, np.full(len(points), ABOVE)])
    below_tire, seen, grip = (wp.zeros(len(points), dtype=float, device="cpu") for _ in range(3))
    base: wp.array = wp.array([friction], dtype=float, device="cpu")
    wp.launch(
        look_down, dim=len(points), device="cpu",
        inputs=[wp.array(at, dtype=wp.vec3d, device="cpu"), terrain, tables, model.assets, base],
        outputs=[below_tire, seen, grip],
    )  # fmt: skip
    options = road.soil_options() or {"soil": "mid"}
    soil = Soil(model, [SoilSphere(body=0, radius=0.1)], ground=terrain, **options)
    below = soil.height(points).numpy()[0]
    return ABOVE + below_tire.numpy(), ABOVE - seen.numpy(), grip.numpy(), below


def test_tires_rays_and_soil_meet_one_height():
    road = random_road("F", seed=3, x=(-8.0, 12.0), y=(-4.0, 4.0))
    points = np.random.default_rng(1).uniform((-7.9, -3.9), (11.9, 3.9), (2000, 2))
    below_tire, seen, _, below = queried(road, points)
    wanted = road.height_at(points)
    assert np.ptp(wanted) > 0.2
    # float32 distances of 4 m: a rounding is 2.4e-7 m, a few of them
    for found in (below_tire, seen, below):
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=3e-6)
    nodes = road.heights[::20, ::50]
    y, x = np.mgrid[: nodes.shape[0], : nodes.shape[1]]
    places = np.stack([road.origin[0] + 2.5 * x.ravel(), road.origin[1] + 2.0 * y.ravel()], axis=1)
    np.testing.assert_allclose(road.height_at(places), nodes.ravel(), rtol=0.0, atol=1e-6)


def test_maps_lie_over_the_same_rectangle():
    heights = np.zeros((3, 5), np.float32)
    friction, soil = np.array([[0.9, 0.3], [0.6, 0.1]]), np.array([[0, 1]], np.int32)
    road = RoadSurface(
        heights=heights, origin=(-1.0, 2.0), size=(4.0, 2.0), friction=friction, soil=soil, soils=("mid", "hard")
    )
    corners = np.array([[-0.5, 2.2], [2.5, 2.2], [-0.5, 3.8], [2.5, 3.8]])
    _, _, grip, below = queried(road, corners, friction=0.8, below_soil=True)
    np.testing.assert_allclose(grip, friction.ravel(), rtol=1e-6)
    np.testing.assert_allclose(below, 0.0, atol=1e-6)


@pytest.mark.parametrize("below_soil", [False, True])
def test_bodies_meet_the_road_unless_soil_covers_it(below_soil):
    """A ball that falls 5 mm onto a level road stays on it."""
    road = RoadSurface(heights=np.full((2, 2), 0.3, np.float32), origin=(-2.0, -2.0), size=(4.0, 4.0))
    builder = sw.ModelBuilder()
    builder.add_body("ball", mass=1.0, inertia=(0.004, 0.004, 0.004), pose=sw.pose((0.5, 0.2, 0.405)))
    builder.add_shape_sphere(0, radius=0.1)
    add_road(builder, road, below_soil=below_soil)
    simulation = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    simulation.step(200)
    z = float(simulation.state.body_x.numpy()[0, 0, 2])
    if below_soil:
        # it falls freely for 0.2 s; first order in the step
        assert z == pytest.approx(0.405 - 0.5 * 9.81 * 0.2**2, abs=2e-3)
    else:
        assert z == pytest.approx(0.4, abs=1e-4)
