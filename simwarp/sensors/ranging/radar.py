"""Radar: where something reflects and how fast it recedes, ray by ray and gathered into clusters."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
import warp as wp

from simwarp.core.arrays import with_zeros, writable_from
from simwarp.core.constraints import Ge, Meaning, NotNegative, Positive
from simwarp.core.types import ModelError
from simwarp.model.checks import checked_names
from simwarp.sensors.clock import Field, mount_arrays
from simwarp.sensors.frame_sensor import FrameSensor
from simwarp.sensors.interface import Configuration, Mount, Schedule, checked_config
from simwarp.sensors.ranging.beams import Beams
from simwarp.sensors.ranging.clusters_kernels import CLUSTER_CHANNELS, ClusterFrames, ClusterScratch, cluster_returns
from simwarp.sensors.ranging.radar_kernels import CHANNELS, RadarNoiseArrays, scan_radar
from simwarp.sensors.ranging.scanning import (
    PerWorld,
    Share,
    check_reach,
    noise_arrays,
    rows_of,
    scan_tables,
    scene_model,
    set_sweep,
    thread_count,
)
from simwarp.sensors.scene import ALL_GROUPS, GroupBits, Scene

if TYPE_CHECKING:
    from simwarp.simulation.attachments import StepContext


@dataclasses.dataclass(frozen=True, kw_only=True)
class RadarNoise(Configuration):
    """Noise of a radar: each a number, or one per world.

    Attributes:
        range: standard deviation of ranges [m].
        azimuth, elevation: of angles [rad].
        velocity: of range rates [m/s].
        amplitude: of amplitudes.
        threshold: returns whose measured amplitude is below it are lost.
        dropout: probability that a ray is lost.

    Raises:
        ModelError: a number is negative, or a probability above 1.
    """

    range: PerWorld = 0.0
    azimuth: PerWorld = 0.0
    elevation: PerWorld = 0.0
    velocity: PerWorld = 0.0
    amplitude: PerWorld = 0.0
    threshold: PerWorld = 0.0
    dropout: Share = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Clusters(Configuration):
    """Clustering of returns: DBSCAN in which every return counts (least 1), by distance in space alone.

    Attributes:
        distance: returns at most this far apart belong together [m].
        least: clusters of fewer returns are dropped.
        capacity: of a world.

    Raises:
        ModelError: a value breaks its rule.
    """

    distance: Annotated[Positive, Meaning("the largest gap within a cluster [m]")] = 1.0
    least: Annotated[int, Ge(1)] = 1
    capacity: Annotated[int, Ge(1)] = 64


@dataclasses.dataclass(frozen=True, kw_only=True)
class RadarConfig(Configuration):
    """A radar.

    Attributes:
        schedule: column c of C is measured at window · c / C; with window 0 all are measured at once.
        rays: directions of the rays.
        near, far: ranges between which surfaces are seen [m].
        noise: see `RadarNoise`.
        falloff: k of the amplitude's law r^-k with r in metres: 0 none, 4 the radar equation.
        clusters: clustering of returns; None: none.
        sweep: see `LidarConfig`.
        groups: bits of the groups of instances that it sees (`Appearance.group`).

    Raises:
        ModelError: a value breaks its rule.
    """

    schedule: Schedule
    rays: Beams
    near: NotNegative = 1.0e-3
    far: Annotated[Positive, Meaning("the largest range [m]")] = 100.0
    noise: RadarNoise = dataclasses.field(default_factory=RadarNoise)
    falloff: Annotated[NotNegative, Meaning("4 for the radar equation")] = 0.0
    clusters: Clusters | None = None
    sweep: bool = True
    groups: GroupBits = ALL_GROUPS

    def check(self) -> None:
        """Checks that there is something between near and far.

        Raises:
            ModelError: `near` is not below `far`.
        """
        check_reach("RadarConfig", self.near, self.far)


class Radar(FrameSensor):
    """Measures range, direction and range rate in every world; a `Sensor` for `Simulation(sensors=[...])`.

    The range rate is that of the surface that a ray meets, seen from the moving sensor, positive where it goes away:
    what stands beside the road comes closer.

    Args:
        scene: instances that it sees (`Visuals.finalize`).
        mount: body and pose; x ahead, y left, z up.
        config: see `RadarConfig`; there is no default.
        name: unique in a Simulation; part of its randomness.
        seed: of its randomness.
        per_world: names of numbers of the noise, "mount" and "backscatter", that get a row per world, to be written
            between steps.

    Attributes:
        mount: `position` (1 or W,) vec3d [m] and `rotation` quatd on the body.
        noise: arrays (1 or W,) by the names of `RadarNoise`.
        backscatter: (1 or W, instances) of the scene; as built its reflectances.

    Raises:
        ModelError: the body does not exist, the noise does not fit the worlds, or `per_world` names something else.
    """

    only_in_windows: ClassVar[bool] = True

    def __init__(
        self, scene: Scene, mount: Mount, config: RadarConfig | None = None, *, name: str = "radar", seed: int = 0,
        per_world: Iterable[str] = (),
    ) -> None:  # fmt: skip
        thing = f"radar '{name}'"
        model = scene_model(thing, scene)
        config = checked_config(name, config, RadarConfig, default=False)
        self.config, self.scene = config, scene
        wanted = checked_names(thing, "per_world", per_world, (*vars(config.noise), "mount", "backscatter"))
        rows, columns = config.rays.shape
        fields = {"returns": Field((rows, columns, CHANNELS), wp.float32)}
        if config.clusters is not None:
            fields["clusters"] = Field((config.clusters.capacity, CLUSTER_CHANNELS), wp.float32)
            fields["cluster_count"] = fields["cluster_overflow"] = Field((), wp.int32)
        super().__init__(name, config.schedule, model, fields, seed=seed, gradual=True)
        self.noise = noise_arrays(thing, config.noise, model, wanted)
        values = scene.reflectance.numpy()
        copies = model.world_count if "backscatter" in wanted and len(values) == 1 else 1
        self.backscatter = writable_from(np.tile(values, (copies, 1)), wp.float32, model.device)
        self.mount = mount_arrays(name, mount, model, model.world_count if "mount" in wanted else 1)
        self._scan = scan_tables(self.mount, config.rays, config.near, config.far, model.device)
        self._noise = RadarNoiseArrays()
        for key, array in self.noise.items():
            setattr(self._noise, key, array)

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """The mount, numbers of the noise, and what the scene shows."""
        noise = {f"noise_{name}": array for name, array in self.noise.items()}
        return {**super().world_parameters, **noise, "backscatter": self.backscatter, **self.scene.world_parameters}

    @property
    def data(self) -> wp.array:
        """(W, rows, columns, 6) float32 by ray: range [m], azimuth (to the left), elevation (upwards) [rad], range rate
        (positive: going away) [m/s], amplitude, index of the scene's instance. Nothing: zeros and instance -1.
        """
        return self.frames.data["returns"]

    @property
    def clusters(self) -> wp.array:
        """(W, capacity, 6) float32: centroid x, y, z in sensor axes [m], mean range rate [m/s], sum of amplitudes,
        number of returns. Ordered by their first ray (row by row from the top); zeros beyond `cluster_count`.
        """
        return self._of_clusters("clusters")

    @property
    def cluster_count(self) -> wp.array:
        """(W,) int32: clusters in the frame, at most the capacity."""
        return self._of_clusters("cluster_count")

    @property
    def cluster_overflow(self) -> wp.array:
        """(W,) int32: clusters that found no place; raise `Clusters.capacity` if it is not 0."""
        return self._of_clusters("cluster_overflow")

    def _sample(self, simulation: StepContext) -> list[Any]:
        frames, state, device = self.frames, simulation.state, self.model.device
        tables = self.scene.tables(self.config.groups)
        set_sweep(self._scan, frames, self.config.sweep)
        threads = thread_count(self.config.rays, frames, device)
        returns = rows_of(frames.ring["returns"])
        scan = simulation.shares.record(
            scan_radar, threads,
            inputs=[
                threads, self._scan, float(self.config.falloff), self.backscatter, self._noise, state.arrays, tables,
                self.model.assets, frames.tick,
            ],
            outputs=[returns],
        )  # fmt: skip
        commands = [*self.scene.record_place(simulation, tables, frames.tick.collecting), scan]
        if self.config.clusters is not None:
            commands.append(self._gather(simulation, self.config.clusters, returns))
        return commands

    def _gather(self, simulation: StepContext, config: Clusters, returns: wp.array) -> Any:
        """The launch that finds the clusters."""
        worlds, device, ring = self.model.world_count, self.model.device, self.frames.ring
        results: Any = ClusterFrames()
        results.cluster = rows_of(ring["clusters"])
        results.count, results.overflow = ring["cluster_count"], ring["cluster_overflow"]
        self._scratch = cluster_scratch(worlds, returns.shape[1] // CHANNELS, device)
        return simulation.shares.record(
            cluster_returns,
            inputs=[
                float(config.distance), int(config.least), int(config.capacity), returns, self._scratch,
                self.frames.tick,
            ],
            outputs=[results],
        )  # fmt: skip

    def _scratch_bytes(self, dt: float) -> int:
        """Of what gathers the clusters."""
        rays = self.config.rays.shape[0] * self.config.rays.shape[1]
        words = 12 + (1 << (2 * rays - 1).bit_length()) / rays
        return 0 if self.config.clusters is None else round(4 * self.model.world_count * rays * words)

    def _of_clusters(self, name: str) -> wp.array:
        if self.config.clusters is None:
            raise ModelError(f"radar '{self.name}': there are no clusters; pass RadarConfig(clusters=Clusters())")
        return self.frames.data[name]


def cluster_scratch(worlds: int, rays: int, device: Any) -> ClusterScratch:
    """Scratch of `cluster_returns` for this many rays in each world."""
    slots = 1 << (2 * rays - 1).bit_length()
    scratch = with_zeros(ClusterScratch(), (worlds, rays), device)
    table: ClusterScratch = with_zeros(scratch, (worlds, slots), device, "table")
    return table
