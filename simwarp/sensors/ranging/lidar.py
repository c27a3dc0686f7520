"""Lidar: beams that sweep the scene and come back as a point cloud, a range image, or both."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal, TypeAlias, get_args

import numpy as np
import warp as wp

from simwarp.core.constraints import As, Different, Meaning, MinLen, NotNegative, OneOrMany, Positive
from simwarp.core.types import ModelError, formatted
from simwarp.model.checks import checked_names
from simwarp.sensors.clock import Field, mount_arrays
from simwarp.sensors.frame_sensor import FrameSensor
from simwarp.sensors.interface import Configuration, Mount, Schedule, checked_config
from simwarp.sensors.ranging.beams import Beam, Beams
from simwarp.sensors.ranging.lidar_kernels import LidarNoiseArrays, LidarSettings, count_returns, scan_lidar
from simwarp.sensors.ranging.returns_kernels import ReturnMode
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

MODES: Final = tuple(mode.name.lower() for mode in ReturnMode)
Output: TypeAlias = Literal["points", "ranges"]
OutputNames: TypeAlias = Annotated[tuple[Output, ...], MinLen(1), Different, OneOrMany()]
OUTPUTS: Final = get_args(Output)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LidarNoise(Configuration):
    """Noise of a lidar: each a number, or one per world.

    Attributes:
        range: standard deviation of ranges [m].
        azimuth, elevation: of the angles under which a point is reported [rad].
        intensity: of intensities; what they would make negative is shown as 1e-6.
        threshold: returns whose measured intensity is below it are lost.
        dropout: probability that a beam is lost.

    Raises:
        ModelError: a number is negative, or a probability above 1.
    """

    range: PerWorld = 0.0
    azimuth: PerWorld = 0.0
    elevation: PerWorld = 0.0
    intensity: PerWorld = 0.0
    threshold: PerWorld = 0.0
    dropout: Share = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class LidarConfig(Configuration):
    """A lidar.

    Attributes:
        schedule: the window is the time of one sweep: column c of C fires at window · c / C; 0: all fire at once.
        beams: directions of the beams.
        beam: width of a beam.
        mode: "strongest", "first", "last", "mean", or "dual" (strongest and first: twice the channels).
        near, far: ranges between which surfaces are seen [m]. Rays begin at `near`: a housing inside it hides nothing.
        noise: see `LidarNoise`.
        outputs: "points", "ranges" or both; the first is `data`.
        miss: value of the range image without a return: "zero", "inf" or "far". Intensities are 0 there, and
            only there; points are zero in all their components.
        sweep: columns fire from where the sensor is at their own time, to first order between sub-steps; else from
            where it is at the end of the sub-step in which their time falls.
        groups: bits of the groups of instances that it sees (`Appearance.group`).

    Raises:
        ModelError: a value breaks its rule.
    """

    schedule: Schedule
    beams: Beams
    beam: Beam = dataclasses.field(default_factory=Beam)
    mode: Literal["strongest", "first", "last", "mean", "dual"] = "strongest"
    near: NotNegative = 1.0e-3
    far: Annotated[Positive, Meaning("the largest range [m]")] = 100.0
    noise: LidarNoise = dataclasses.field(default_factory=LidarNoise)
    outputs: Annotated[Sequence[str], As(OutputNames)] = ("points", "ranges")
    miss: Literal["zero", "inf", "far"] = "zero"
    sweep: bool = True
    groups: GroupBits = ALL_GROUPS

    def check(self) -> None:
        """Checks that there is something between near and far.

        Raises:
            ModelError: `near` is not below `far`.
        """
        check_reach("LidarConfig", self.near, self.far)


class Lidar(FrameSensor):
    """Scans every world; a `Sensor` for `Simulation(sensors=[...])`.

    Sensor axes: x ahead, y left, z up, those of the mount. Points are given in the axes that the sensor had when their
    beam fired: the cloud of a moving sensor is sheared, as a real one's is. The other bodies stand, within a sub-step,
    where they are at its end.

    Args:
        scene: instances that it sees (`Visuals.finalize`).
        mount: body and pose.
        config: see `LidarConfig`; there is no default.
        name: unique in a Simulation; part of its randomness.
        seed: of its randomness.
        per_world: names of numbers of the noise, and "mount", that get a row per world, to be written between steps.

    Attributes:
        mount: `position` (1 or W,) vec3d [m] and `rotation` quatd on the body.
        noise: arrays (1 or W,) by the names of `LidarNoise`.

    Raises:
        ModelError: the body does not exist, the noise does not fit the worlds, or `per_world` names something else.
    """

    only_in_windows: ClassVar[bool] = True

    def __init__(
        self, scene: Scene, mount: Mount, config: LidarConfig | None = None, *, name: str = "lidar", seed: int = 0,
        per_world: Iterable[str] = (),
    ) -> None:  # fmt: skip
        thing = f"lidar '{name}'"
        model = scene_model(thing, scene)
        config = checked_config(name, config, LidarConfig, default=False)
        self.config, self.scene = config, scene
        wanted = checked_names(thing, "per_world", per_world, (*vars(config.noise), "mount"))
        self.returns = 2 if config.mode == "dual" else 1
        rows, columns = config.beams.shape
        widths = {"points": 4 * self.returns, "ranges": 2 * self.returns}
        fields: dict[str, Field] = {
            output: Field((rows, columns, widths[output]), wp.float32) for output in config.outputs
        }
        fields["count"] = Field((), wp.int32)
        super().__init__(name, config.schedule, model, fields, seed=seed, gradual=True)
        self.noise = noise_arrays(thing, config.noise, model, wanted)
        self.mount = mount_arrays(name, mount, model, model.world_count if "mount" in wanted else 1)
        self._scan = scan_tables(self.mount, config.beams, config.near, config.far, model.device)
        self._settings = LidarSettings()
        self._settings.mode = int(ReturnMode[config.mode.upper()])
        self._settings.miss = {"zero": 0.0, "inf": math.inf, "far": config.far}[config.miss]
        self._settings.points = int("points" in config.outputs)
        self._settings.ranges = int("ranges" in config.outputs)
        self._settings.ray = wp.array(np.tan(config.beam.offsets()), dtype=wp.vec2, device=model.device)
        self._nowhere = wp.zeros((1, 1), dtype=wp.float32, device=model.device)
        self._noise = LidarNoiseArrays()
        for key, array in self.noise.items():
            setattr(self._noise, key, array)

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """The mount, numbers of the noise, and what the scene shows."""
        noise = {f"noise_{name}": array for name, array in self.noise.items()}
        return {**super().world_parameters, **noise, **self.scene.world_parameters}

    @property
    def data(self) -> wp.array:
        """The first of the outputs, float32: (W, rows, columns, 4) as `points` or (W, rows, columns, 2) as `ranges`;
        twice the channels in mode dual.
        """
        return self.frames.data[self.config.outputs[0]]

    @property
    def points(self) -> wp.array:
        """(W, rows, columns, 4) float32: x, y, z [m] in sensor axes, intensity. In mode dual 8: strongest, first."""
        return self._output("points")

    @property
    def ranges(self) -> wp.array:
        """(W, rows, columns, 2) float32: range [m], intensity. In mode dual 4: strongest, first."""
        return self._output("ranges")

    @property
    def count(self) -> wp.array:
        """(W,) int32: returns in the frame; those of mode dual count twice."""
        return self.frames.data["count"]

    def _sample(self, simulation: StepContext) -> list[Any]:
        frames, state, device = self.frames, simulation.state, self.model.device
        tables = self.scene.tables(self.config.groups)
        set_sweep(self._scan, frames, self.config.sweep)
        threads = thread_count(self.config.beams, frames, device)
        flat = {name: rows_of(frames.ring[name]) for name in self.config.outputs}
        points, ranges = (flat.get(name, self._nowhere) for name in OUTPUTS)
        scan = simulation.shares.record(
            scan_lidar, threads,
            inputs=[
                threads, self._scan, self._settings, self._noise, state.arrays, tables, self.model.assets, frames.tick,
            ],
            outputs=[points, ranges],
        )  # fmt: skip
        first = self.config.outputs[0]
        count = simulation.shares.record(
            count_returns,
            inputs=[frames.tick, 4 if first == "points" else 2, flat[first]], outputs=[frames.ring["count"]],
        )  # fmt: skip
        return [*self.scene.record_place(simulation, tables, frames.tick.collecting), scan, count]

    def _output(self, name: str) -> wp.array:
        if name not in self.config.outputs:
            raise ModelError(
                f"lidar '{self.name}': '{name}' is not among its outputs {formatted(self.config.outputs)}; "
                "add it to LidarConfig.outputs"
            )
        return self.frames.data[name]
