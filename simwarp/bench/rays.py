"""Rows of rays: closest hits through the whole instance path, and Embree on the same rays."""

from __future__ import annotations

import importlib.util
import time
from typing import Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.bench.health import Health
from simwarp.bench.measure import Row, bytes_of, time_and_judge
from simwarp.bench.timing import counted_launches
from simwarp.core.memory import check_fits
from simwarp.model.builder import ModelBuilder
from simwarp.sensors.ray_casting_kernels import cast_rays
from simwarp.sensors.scene import Visuals
from simwarp.simulation.simulation import Simulation

Floats = npt.NDArray[np.float64]

VIEW: Final = (80, 45)
"""Rays of a world: columns and rows of a picture."""
TRIANGLES: Final = {"rays-10k": 10_000, "rays-200k": 200_000}
_SEED: Final = 5
RAY_BYTES: Final = 250
"""That a ray takes while its start and direction are computed."""
FEWER: Final = "use fewer worlds"
REACH: Final = 1000.0
"""Of a ray [m]."""


def bumpy_ball(triangles: int) -> tuple[Floats, npt.NDArray[np.int64]]:
    """A ball of 3 m with dents, of about so many triangles."""
    rows = round((triangles / 4.0) ** 0.5)
    columns = 2 * rows
    polar, azimuth = np.meshgrid(np.linspace(0.01, np.pi - 0.01, rows + 1), np.arange(columns) * 2.0 * np.pi / columns)
    unit = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], -1)
    vertices = 3.0 * unit * (1.0 + 0.15 * np.sin(7.0 * unit[..., :1]) * np.cos(5.0 * unit[..., 1:2]))
    here = np.arange(columns)[:, None] * (rows + 1) + np.arange(rows)
    there = np.roll(here, -1, axis=0)
    first = np.stack([here, here + 1, there + 1], -1).reshape(-1, 3)
    second = np.stack([here, there + 1, there], -1).reshape(-1, 3)
    return vertices.reshape(-1, 3), np.concatenate([first, second])


def views(count: int) -> tuple[Floats, Floats]:
    """Starts and unit directions (count, rays, 3) of cameras about the ball that look at it."""
    draws = np.random.default_rng(_SEED)
    place = draws.standard_normal((count, 3))
    place *= draws.uniform(5.0, 7.0, (count, 1)) / np.linalg.norm(place, axis=1, keepdims=True)
    ahead = -place / np.linalg.norm(place, axis=1, keepdims=True)
    left = np.cross((0.0, 0.0, 1.0), ahead)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    up = np.cross(ahead, left)
    v, u = (grid.reshape(-1) for grid in np.meshgrid(np.linspace(0.4, -0.4, VIEW[1]), np.linspace(0.7, -0.7, VIEW[0]),
                                                     indexing="ij"))  # fmt: skip
    direction = ahead[:, None] + u[:, None] * left[:, None] + v[:, None] * up[:, None]
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.broadcast_to(place[:, None], direction.shape), direction


class RayRun:
    """Rays of many views at one mesh, in worlds of their own."""

    horizon_steps = 1 << 30

    def __init__(self, triangles: int, worlds: int, device: str) -> None:
        check_fits(f"rays of {worlds} worlds", RAY_BYTES * VIEW[0] * VIEW[1] * worlds, wp.get_device(device), FEWER)
        self.mesh = bumpy_ball(triangles)
        builder = ModelBuilder()
        body = builder.add_body("ball", mass=1.0, inertia=(1.0, 1.0, 1.0))
        visuals = Visuals(builder)
        visuals.add_mesh(body, *self.mesh)
        self.sim = Simulation(builder.finalize(worlds, device), 1e-3)
        self.scene = visuals.finalize(self.sim.model)
        self.start, self.direction = views(worlds)
        shape = self.start.shape[:2]
        self.distance = wp.zeros(shape, dtype=float, device=device)
        outputs = [self.distance, *(wp.zeros(shape, dtype=dtype, device=device) for dtype in (wp.vec3, wp.int32))]
        tables = self.scene.tables()
        inputs = [tables, self.sim.model.assets, wp.array(np.array(self.start), dtype=wp.vec3d, device=device),
                  wp.array(self.direction, dtype=wp.vec3, device=device), REACH]  # fmt: skip
        self._place = self.scene.record_place(self.sim, tables)
        self._cast = self.sim.shares.record(cast_rays, shape[1], inputs=inputs, outputs=outputs)

    def step(self) -> None:
        """Places the ball, casts all rays."""
        self.sim.shares.run([*self._place, self._cast])

    def restart(self) -> None:
        """Nothing moves."""

    def wait(self) -> None:
        """Until the device is done."""
        wp.synchronize_device(self.sim.model.device)

    def examine(self) -> Health:
        """Three quarters of the rays hit, at distances that are possible."""
        hit = self.distance.numpy()
        share = float((hit >= 0.0).mean())
        sound = 0.3 < share < 0.999 and hit.max() < 10.5
        return Health(
            () if sound else (f"{100 * share:.0f} % of the rays hit, up to {hit.max():.3g} m",), 0.0, 0.0, 0.0, 0.0
        )


def measure_rays(name: str, worlds: int, device: str, dt: float | None, seconds: float) -> Row:
    """Times rays; a step is one ray."""
    began = time.perf_counter()
    run = RayRun(TRIANGLES[name], worlds, device)
    run.step()
    run.wait()
    row = Row("simwarp", name, worlds, 0.0, compile_s=time.perf_counter() - began)
    row.bytes_per_world, row.bytes_shared = bytes_of(lambda count: RayRun(TRIANGLES[name], count, device))
    single = RayRun(TRIANGLES[name], 1, device)
    single.step()
    with counted_launches() as launches:
        single.step()
    row.launches_per_step = launches.total
    return time_and_judge(row, run, run.distance.size, seconds, run.examine)


class EmbreeRun:
    """The same rays through Embree, ray by ray on one thread."""

    horizon_steps = 1 << 30

    def __init__(self, run: RayRun) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.ours = run
        self.scene = EmbreeScene()
        vertices, triangles = run.mesh
        TriangleMesh(self.scene, vertices.astype(np.float32), triangles.astype(np.int32))
        self.start = np.ascontiguousarray(run.start.reshape(-1, 3), np.float32)
        self.direction = np.ascontiguousarray(run.direction.reshape(-1, 3), np.float32)
        self.distance = np.zeros(0)

    def step(self) -> None:
        """Casts all rays."""
        self.distance = self.scene.run(self.start, self.direction, query="DISTANCE")

    def restart(self) -> None:
        """Nothing moves."""

    def wait(self) -> None:
        """It is done when it returns."""

    def examine(self) -> Health:
        """Both must agree on what is hit, and where."""
        ours = self.ours.distance.numpy().reshape(-1)
        hit, other = ours >= 0.0, self.distance < 1e10
        problems = []
        if (hit != other).mean() > 1e-4:
            problems.append(f"{int((hit != other).sum())} rays hit for one and miss for the other")
        both = hit & other
        if not np.allclose(ours[both], self.distance[both], rtol=1e-3):
            problems.append("distances differ from simwarp's by more than 1e-3")
        return Health(tuple(problems), 0.0, 0.0, 0.0, 0.0)


def measure_embree(name: str, worlds: int, device: str, dt: float | None, seconds: float) -> Row:
    """Times Embree on the rays of `measure_rays`."""
    ours = RayRun(TRIANGLES[name], worlds, device)
    ours.step()
    began = time.perf_counter()
    run = EmbreeRun(ours)
    run.step()
    row = Row("embree", name, worlds, 0.0, compile_s=time.perf_counter() - began, launches_per_step=0)
    return time_and_judge(row, run, ours.distance.size, seconds, run.examine)


def embree_notes() -> list[str]:
    """Reasons why Embree is missing from the table, one line each."""
    if importlib.util.find_spec("embreex") is None:
        return ["embree: not installed; run: pip install embreex"]
    return []
