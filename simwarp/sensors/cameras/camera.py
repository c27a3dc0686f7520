"""Cameras: pictures, depth, normals and segmentation of all worlds, as the lens, the lights and the chip make them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal, TypeAlias

import numpy as np
import warp as wp

from simwarp.core.arrays import with_zeros
from simwarp.core.constraints import As, Different, Ge, Le, Meaning, MinLen, NotNegative, Positive
from simwarp.core.rotation import quat_from_matrix
from simwarp.core.types import ModelError, Pose, Vec3, finite_vector, formatted, pose
from simwarp.model.checks import checked_names
from simwarp.sensors.cameras.image_kernels import Camera as CameraNumbers, Outputs, Views, aim_views, render
from simwarp.sensors.cameras.image_processing import PER_WORLD as IMAGING_ARRAYS, ImageProcessing, Imaging
from simwarp.sensors.cameras.lenses import LensField, Pinhole
from simwarp.sensors.cameras.lights import PER_WORLD as LIGHT_ARRAYS, Lighting, Lights
from simwarp.sensors.clock import Field, mount_arrays
from simwarp.sensors.frame_sensor import FrameSensor
from simwarp.sensors.interface import Configuration, Mount, Schedule, checked_config
from simwarp.sensors.ranging.scanning import scene_model
from simwarp.sensors.scene import ALL_GROUPS, GroupBits, Scene

if TYPE_CHECKING:
    from simwarp.simulation.attachments import StepContext

OUTPUTS: Final[dict[str, tuple[int, int, Any]]] = {
    "rgb": (1, 3, wp.uint8),
    "grey": (2, 1, wp.uint8),
    "depth": (4, 1, wp.float32),
    "range": (8, 1, wp.float32),
    "normals": (16, 3, wp.float32),
    "instance": (32, 1, wp.int32),
    "semantic": (64, 1, wp.int32),
}
"""Bit in the kernels, channels and dtype of each output."""
LIGHT_OUTPUTS: Final = ("rgb", "grey")
MOST_SAMPLES: Final = 16
MOST_PIXELS: Final = 32768
"""Along either side of an image."""
Pixels: TypeAlias = Annotated[int, Ge(1), Le(MOST_PIXELS)]
Output: TypeAlias = Literal["rgb", "grey", "depth", "range", "normals", "instance", "semantic"]
OutputNames: TypeAlias = Annotated[tuple[Output, ...], MinLen(1), Different]


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraConfig(Configuration):
    """Configuration of a camera. It looks along X of its mount; Y is to the left, Z up.

    Attributes:
        schedule: times of the frames. With a window `rgb` and `grey` are means over it (motion blur); depth, normals
            and labels are those at its end.
        width, height: of the image [pixels].
        lens: `Pinhole`, `FishEye` or `Radial`.
        outputs: any of `rgb`, `grey` (uint8), `depth` (along the axis), `range` (along the ray) [m], `normals` (unit,
            camera axes, towards the camera), `instance` (index in the scene), `semantic` (label); nothing is seen:
            `far`, zeros, -1. The first one is `Camera.data`.
        samples: s: s x s rays for each pixel of `rgb` and `grey`, one at random in each of as many squares. With a
            window there is at least one ray per sub-step.
        near: near distance: anything nearer, such as the housing, is not seen [m].
        far: far distance: anything farther is not seen [m].
        imaging: exposure, response, vignetting and noise.
        grey_weights: of red, green and blue in `grey`.
        groups: bits of the groups of instances that are seen.

    Raises:
        ModelError: a number, an output or the lens is not usable.
    """

    schedule: Schedule = dataclasses.field(default_factory=lambda: Schedule(rate=30.0))
    width: Pixels = 80
    height: Pixels = 45
    lens: LensField = dataclasses.field(default_factory=Pinhole)
    outputs: Annotated[Sequence[str], As(OutputNames)] = ("rgb",)
    samples: Annotated[int, Ge(1), Le(MOST_SAMPLES)] = 1
    near: Annotated[NotNegative, Meaning("metres, 0 to see everything")] = 0.0
    far: Annotated[Positive, Meaning("the largest distance that is seen [m]")] = 1000.0
    imaging: Imaging = dataclasses.field(default_factory=Imaging)
    grey_weights: tuple[float, float, float] = (1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0)
    groups: GroupBits = ALL_GROUPS

    def check(self) -> None:
        """Checks that the lens fits the image, and that there is something to see.

        Raises:
            ModelError: 0 <= near < far does not hold, or the lens is none or does not fit the image.
        """
        camera_numbers(self)


class Camera(FrameSensor):
    """A camera on a body, or fixed in the world, in every world: a `Sensor` for `Simulation(sensors=[...])`.

    Args:
        scene: instances that it sees.
        mount: body and pose.
        config: configuration of the camera.
        lights: of the scene; several cameras may share one `Lights`.
        name: unique in the Simulation.
        seed: of its noise, with the name.
        per_world: arrays that get a row per world: names of `ImageProcessing`, of `Lights` (where a `Lighting` is
            given), and "mount".

    Attributes:
        outputs: by name, (W, height, width, channels): one array each, the same memory throughout.
        lights: the light's arrays, to write into.
        image_processing: the arrays of exposure and noise, to write into.
        mount: the mount's arrays, to write into.

    Raises:
        ModelError: the body, or a name in `per_world`, is not usable.
    """

    only_in_windows: ClassVar[bool] = True

    def __init__(
        self, scene: Scene, mount: Mount, config: CameraConfig | None = None, *,
        lights: Lights | Lighting | None = None, name: str = "camera", seed: int = 0, per_world: Iterable[str] = (),
    ) -> None:  # fmt: skip
        config = checked_config(name, config, CameraConfig)
        model = scene_model(f"camera '{name}'", scene)
        wanted = checked_names(f"camera '{name}'", "per_world", per_world, (*IMAGING_ARRAYS, *LIGHT_ARRAYS, "mount"))
        self.scene, self.config = scene, config
        self.numbers = camera_numbers(config)
        self._lit = any(output in LIGHT_OUTPUTS for output in config.outputs)
        fields: dict[str, Field] = {
            output: Field((config.height, config.width, OUTPUTS[output][1]), OUTPUTS[output][2])
            for output in config.outputs
        }
        super().__init__(name, config.schedule, model, fields, seed=seed)
        copies = model.world_count if "mount" in wanted else 1
        self.mount = mount_arrays(name, mount, model, copies)
        self.image_processing = ImageProcessing(
            config.imaging, model.world_count, model.device, wanted & {*IMAGING_ARRAYS}
        )
        self.lights = lights_of(lights, scene, wanted & {*LIGHT_ARRAYS})
        self._tables = scene.tables(config.groups)
        self._views = with_zeros(Views(), model.world_count, model.device)
        self._sums = wp.zeros((0, 0), dtype=wp.vec3, device=model.device)

    @property
    def data(self) -> wp.array:
        """(W, height, width, channels) of the first output."""
        return self.outputs[self.config.outputs[0]]

    @property
    def outputs(self) -> dict[str, wp.array]:
        """The published frames by name of the output: (W, height, width, channels), see `CameraConfig.outputs`."""
        return self.frames.data

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """Frames, clock, and the light of a frame that is being collected."""
        return {**super().memory, **({"sums": self._sums} if self._sums.size else {})}

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """The mount, exposure and noise, lights, and what the scene shows."""
        images = {f"image_{name}": getattr(self.image_processing, name) for name in IMAGING_ARRAYS}
        lights = {f"light_{name}": getattr(self.lights, name) for name in LIGHT_ARRAYS}
        return {**super().world_parameters, **images, **lights, **self.scene.world_parameters}

    def _scratch_bytes(self, dt: float) -> int:
        """Sums of the light over a window."""
        blurred = self._lit and self.config.schedule.steps(dt).window > 1
        return 12 * self.model.world_count * self.config.width * self.config.height if blurred else 0

    def _sample(self, simulation: StepContext) -> list[Any]:
        """Launches of a sub-step: place the scene, aim, cast."""
        model, config, tick = self.model, self.config, self.frames.tick
        window = max(self.frames.steps.window, 1)
        self.numbers.samples = window * math.ceil(config.samples**2 / window)
        if self._lit and window > 1:
            pixels = config.width * config.height
            self._sums = wp.zeros((model.world_count, pixels), dtype=wp.vec3, device=model.device)
        due = tick.collecting if self._lit else tick.complete
        aim = simulation.shares.record(
            aim_views,
            inputs=[self.numbers, self.mount, tick, simulation.state.arrays, self._tables], outputs=[self._views],
        )  # fmt: skip
        inputs, outputs, parts = render_arguments(
            self.numbers, self._views, self.scene, self._tables, self.lights, self.image_processing, self._sums,
            self.frames.ring,
        )  # fmt: skip
        cast = simulation.shares.record(render, parts, inputs=inputs, outputs=outputs)
        return [*self.scene.record_place(simulation, self._tables, due), aim, cast]


def look_at(eye: Vec3, target: Vec3, up: Vec3 = (0.0, 0.0, 1.0)) -> Pose:
    """The pose of a camera at `eye` that looks at `target`, the image's upper side towards `up`.

    Raises:
        ModelError: eye and target are the same place.
    """
    place = finite_vector("look_at", "eye", eye, 3)
    way = finite_vector("look_at", "target", target, 3) - place
    if float(np.linalg.norm(way)) < 1e-9:
        raise ModelError(f"look_at: eye and target must be apart, got {formatted(eye)} for both; move one")
    forward = way / np.linalg.norm(way)
    left = np.cross(finite_vector("look_at", "up", up, 3), forward)
    if float(np.linalg.norm(left)) < 1e-9:  # straight up or down: the image's upper side is X
        left = np.cross((1.0, 0.0, 0.0), forward)
    left /= np.linalg.norm(left)
    return pose(place, quat_from_matrix(np.stack([forward, left, np.cross(forward, left)], axis=1)))


def camera_numbers(config: CameraConfig) -> CameraNumbers:
    """The camera as kernels read it.

    Raises:
        ModelError: a number, an output or the lens is not usable.
    """
    thing, near, far = "CameraConfig", config.near, config.far
    if not near < far:
        raise ModelError(f"{thing}: 0 <= near < far must hold, got near={near:g}, far={far:g} m; swap them")
    if isinstance(config.lens, type) or not (hasattr(config.lens, "numbers") and hasattr(config.lens, "points")):
        found = formatted(config.lens)
        raise ModelError(f"{thing}: lens must be a lens, got {found}; write Pinhole(fov=1.0), FishEye or Radial")
    numbers = CameraNumbers()
    numbers.width, numbers.height = config.width, config.height
    numbers.lens = config.lens.numbers(config.height / config.width)
    numbers.outputs = sum(OUTPUTS[name][0] for name in config.outputs)
    numbers.side = config.samples
    numbers.stride = _stride(config.samples**2)
    numbers.samples = config.samples**2
    numbers.near, numbers.far = near, far
    numbers.spread = 2.0 * numbers.lens.scale / (config.width * config.samples)
    numbers.grey = wp.vec3(*config.grey_weights)
    return numbers


def _stride(strata: int) -> int:
    """A step that visits all strata, soon every part of the pixel: near the golden section, no common divisor."""
    steps = [step for step in range(1, strata + 1) if math.gcd(step, strata) == 1]
    return min(steps, key=lambda step: abs(step - 0.618 * strata))


def lights_of(lights: Lights | Lighting | None, scene: Scene, per_world: Iterable[str]) -> Lights:
    """The lights themselves, or those of a description on the scene's device.

    Raises:
        ModelError: they are of another sort, device or number of worlds, or `per_world` is asked of lights that are
            there already.
    """
    if lights is not None and not isinstance(lights, (Lights, Lighting)):
        raise ModelError(
            f"camera: lights must be Lights or a Lighting, got {formatted(lights)}; write Lighting(suns=[Sun(...)])"
        )
    if isinstance(lights, Lights):
        lights.check(scene.model)
        for name in per_world:
            raise ModelError(
                f"camera: '{name}' belongs to the Lights, which are made already; make them with per_world"
            )
        return lights
    return Lights(Lighting() if lights is None else lights, scene.model.world_count, scene.model.device, per_world)


def render_arguments(
    numbers: CameraNumbers, views: Views, scene: Scene, tables: Any, lights: Lights, image_processing: ImageProcessing,
    sums: wp.array, frames: Mapping[str, wp.array],
) -> tuple[list[Any], list[Any], int]:  # fmt: skip
    """Inputs and outputs of `render`, which casts and develops all views that are due into rows of `frames`, and the
    threads of a view.
    """
    device = scene.model.device
    outputs = Outputs()
    for name, frame in frames.items():
        rows = frame.shape[0]
        setattr(outputs, name, wp.array(
            ptr=frame.ptr, dtype=frame.dtype, shape=(rows, frame.size // rows), device=device, copy=False,
        ))  # fmt: skip
    pixels = numbers.width * numbers.height
    # a launch on a CPU is serial: few threads; on a GPU one each
    chunk = 1 if device.is_cuda else numbers.width
    inputs = [
        chunk, numbers, views, tables, scene.model.assets, scene.appearance, lights.arrays, image_processing.arrays,
    ]  # fmt: skip
    return inputs, [sums, outputs], -(-pixels // chunk)
