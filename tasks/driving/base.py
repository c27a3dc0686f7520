"""What all driving tasks share: a vehicle that the policy drives, where it is put, what it senses, what it hits."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np
import torch

from ..config import TaskConfig, require
from ..frames import heading_quaternion
from ..simulation_access import Equipment
from ..task import Task

if TYPE_CHECKING:
    from simwarp import ModelBuilder, SolverOptions
    from simwarp.model import Model
    from simwarp.sensors.camera import Camera
    from simwarp.sensors.scene import Scene
    from simwarp.vehicle.assembly import VehicleParts
    from simwarp.vehicle.spec import VehicleSpec
    from simwarp.vehicle.vehicle import Vehicle

SETTLING = 0.9
"""Time in which a vehicle comes to rest on its springs before the first episode [s]."""
CHASSIS_GROUP = 2
"""Bit of the collision group of the driven vehicle's chassis; obstacles meet nothing else."""


class Observing(enum.Enum):
    """What a policy sees: a camera's image beside a few numbers, or exact numbers alone."""

    STATE = "state"
    CAMERA = "camera"


@dataclasses.dataclass(frozen=True)
class DrivingConfig(TaskConfig):
    """Fields of every driving task."""

    obs: Observing = Observing.CAMERA
    """camera: an image and what a vehicle measures; state: exact relative positions, which trains fast on a CPU."""
    full: bool = False
    """Drive the full vehicle model instead of the reduced one that policies are trained on."""
    friction: float = 0.9
    """Of tires on the ground."""
    camera_width: int = 80
    """Of the image [pixels]."""
    camera_height: int = 45
    """Of the image [pixels]."""
    camera_fov: float = math.pi / 3.0
    """Horizontal field of view [rad]."""
    camera_rate: float = 20.0
    """Images per second [Hz]."""
    action_rise_time: float | tuple[float, ...] = 0.5
    """Time in which steering and pedals move from 0 to 1 [s]."""

    def validate(self) -> None:
        """Check what all driving tasks share."""
        require(self.friction > 0.0, self, "friction", "positive")
        for field in ("camera_width", "camera_height"):
            require(getattr(self, field) >= 36, self, field, "at least 36: the network's first layers need that many")
        require(0.0 < self.camera_fov < math.pi, self, "camera_fov", "between 0 and pi")
        require(self.camera_rate > 0.0, self, "camera_rate", "positive")


DrivingT = TypeVar("DrivingT", bound=DrivingConfig)


class DrivingTask(Task[DrivingT]):
    """A task whose actions are steering (positive to the left) and the pedals (positive throttle, negative brake).

    A subclass writes `build_world`, `visuals`, and the task methods of its own; its `reset` calls `place_vehicle`.
    """

    action_size: ClassVar[int] = 2
    vehicle_name: ClassVar[str] = "hmmwv-reduced"
    full_name: ClassVar[str] = "hmmwv"
    tire: ClassVar[str | None] = None
    chassis_half: ClassVar[tuple[float, float, float]] = (1.5, 1.0, 0.1)
    """Half lengths of the box that stands for the chassis in contacts [m]."""
    chassis_place: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 0.0)
    """Of its middle in the vehicle's frame of reference [m]."""
    camera_place: ClassVar[tuple[float, float, float]] = (1.5, 0.0, 0.875)
    """In the vehicle's frame of reference [m]."""

    parts: VehicleParts
    vehicle: Vehicle
    camera: Camera | None

    # ---- what a subclass may write -------------------------------------------------------------------------------

    def build_world(self, builder: ModelBuilder) -> None:
        """Add the shapes of one world to the builder: obstacles, walls. Optional."""

    def seen_per_world(self) -> Sequence[str]:
        """Return the arrays of the scene that differ by world."""
        return ()

    def ground(self, model: Model) -> Any:
        """Return the tires' terrain; None is the plane z = 0."""
        return None

    def more_sensors(self, model: Model) -> list[Any]:
        """Return further sensors, such as a GPS. Optional."""
        return []

    def more_elements(self, model: Model) -> list[Any]:
        """Return force elements that come before the vehicle, such as a speed controller. Optional."""
        return []

    # ---- the machinery -------------------------------------------------------------------------------------------

    def build(self, builder: ModelBuilder) -> None:
        """Add the vehicle at the origin, facing +X, then the world's shapes."""
        import simwarp as sw
        from simwarp.vehicle.assembly import add_vehicle

        self.spec = self.make_spec()
        self.parts = add_vehicle(builder, self.spec)
        place = np.asarray(self.chassis_place) + self.parts.reference
        self.chassis_shape = builder.add_shape_box(
            self.parts.chassis, half=self.chassis_half, pose=sw.pose(place), name="chassis_box", group=CHASSIS_GROUP,
            mask=~CHASSIS_GROUP & 0x7FFFFFFF,
        )  # fmt: skip
        self.build_world(builder)
        self._builder = builder
        self._scene: Scene | None = None

    def make_spec(self) -> VehicleSpec:
        """Return the vehicle's description: the reduced or the full model, on this task's tires."""
        from simwarp.vehicle.options import with_options
        from simwarp.vehicle.reading import load_vehicle

        spec = load_vehicle(self.full_name if self.config.full else self.vehicle_name)
        return with_options(spec, tire=self.tire) if self.tire is not None else spec

    def equip(self, model: Model) -> Equipment:
        """Return the vehicle, and the camera where there is one."""
        from simwarp.sensors.camera import Camera, CameraConfig
        from simwarp.sensors.contract import Mount, Schedule
        from simwarp.sensors.lenses import Pinhole
        from simwarp.types import pose
        from simwarp.vehicle.vehicle import Vehicle

        config = self.config
        self.vehicle = Vehicle(self.parts, model, ground=self.ground(model), randomised=True)
        self.vehicle.tires.ground_friction.fill_(config.friction)
        self.camera = None
        sensors: list[Any] = []
        if config.obs is Observing.CAMERA:
            place = np.asarray(self.camera_place) + self.parts.reference
            self.camera = Camera(
                self._scene_of(model), Mount(body=self.parts.chassis, pose=pose(place)),
                CameraConfig(
                    schedule=Schedule(rate=min(config.camera_rate, 1.0 / config.dt)), width=config.camera_width,
                    height=config.camera_height, lens=Pinhole(fov=config.camera_fov),
                ),
            )  # fmt: skip
            sensors.append(self.camera)
        sensors += self.more_sensors(model)
        return Equipment(elements=[*self.more_elements(model), self.vehicle], sensors=sensors)

    def scene(self) -> Scene:
        """Return what the camera sees, and pictures show."""
        return self._scene_of(self.simulation.model)

    def _scene_of(self, model: Model) -> Scene:
        from simwarp.sensors.scene import Visuals
        from simwarp.viewer import paint

        if self._scene is None:
            visuals = Visuals(self._builder)
            visuals.hide(self.chassis_shape)
            self.visuals(visuals)
            paint(visuals)
            self._scene = visuals.finalize(model, per_world=self.seen_per_world(), origin_body=self.parts.chassis)
        return self._scene

    def solver_options(self) -> SolverOptions:
        """A vehicle's rows need no projection: joints stay together by themselves."""
        from simwarp.vehicle.vehicle import VEHICLE_SOLVER

        return VEHICLE_SOLVER

    def setup(self) -> None:
        """Let the vehicle settle on its springs, make views, remember where its bodies are."""
        from simwarp.interop import to_torch

        self.input = to_torch(self.vehicle.input)
        self._settle()
        state = self.simulation.state
        self._x, self._rotation = to_torch(state.body_x), to_torch(state.body_rot)
        self._velocity, self._omega = to_torch(state.body_v), to_torch(state.body_omega)
        self._start_x, self._start_rotation = self._x[0].clone(), self._rotation[0].clone()
        reference = torch.as_tensor(self.parts.reference, dtype=torch.float64, device=self.device)
        self._reference = reference.expand(self.num_worlds, 3)
        contacts = to_torch(self.simulation.contacts.shape_contact_force)
        self._chassis_force = contacts[:, self.chassis_shape]
        self._hit = torch.zeros(self.num_worlds, dtype=torch.bool, device=self.device)

    def _settle(self) -> None:
        self.input.zero_()
        self.input[:, 2] = 1.0
        for _ in range(round(SETTLING / self.config.dt)):
            self.simulation.step()
        self.input.zero_()
        self.simulation.keep_as_initial()

    def apply(self, action: torch.Tensor) -> None:
        """Steering, throttle and brake."""
        self.input[:, 0] = action[:, 0]
        self.input[:, 1] = action[:, 1].clamp(min=0.0)
        self.input[:, 2] = (-action[:, 1]).clamp(min=0.0)

    def begin_step(self) -> None:
        """Forget the touches of the step before."""
        self._hit.zero_()

    def after_physics(self) -> None:
        """Notice a touch that may be over before the control step is."""
        self._hit |= (self._chassis_force != 0.0).any(dim=1)

    # ---- where the vehicle is ------------------------------------------------------------------------------------

    def place_vehicle(
        self, world_mask: torch.Tensor, x: torch.Tensor, y: torch.Tensor, heading: torch.Tensor,
        rise: torch.Tensor | None = None,
    ) -> None:  # fmt: skip
        """Put the settled vehicle at (x, y) [m] with a heading [rad], `rise` above its ground level, at rest.

        Everything is (W,); only the worlds of the mask change. Positions of record keep float64.
        """
        x, y, heading = x.double(), y.double(), heading.double()
        height = torch.zeros_like(x) if rise is None else rise.double()
        cosine, sine = heading.cos().unsqueeze(1), heading.sin().unsqueeze(1)
        start = self._start_x
        moved = torch.stack(
            [
                x.unsqueeze(1) + cosine * start[:, 0] - sine * start[:, 1],
                y.unsqueeze(1) + sine * start[:, 0] + cosine * start[:, 1],
                height.unsqueeze(1) + start[:, 2].expand(len(x), -1),
            ],
            dim=2,
        )
        turned = quat_product(heading_quaternion(heading).unsqueeze(1), self._start_rotation.unsqueeze(0))
        where = world_mask.view(-1, 1, 1)
        self._x.copy_(torch.where(where, moved, self._x))
        self._rotation.copy_(torch.where(where, turned, self._rotation))
        for rates in (self._velocity, self._omega):
            rates.masked_fill_(where, 0.0)
        self.simulation.measure(world_mask, sensors=False)

    def pose(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the reference point (W, 3) float64 [m] and the heading (W,) float32 [rad]."""
        rotation = self._rotation[:, self.parts.chassis]
        point = self._x[:, self.parts.chassis] + turned_vector(rotation, self._reference)
        x, y, z, w = rotation.unbind(dim=1)
        heading = torch.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        return point, heading.float()

    def motion(self) -> torch.Tensor:
        """Return (W, 3) float32: speed ahead and to the left [m/s], yaw rate [rad/s], in axes of the heading."""
        _, heading = self.pose()
        v = self._velocity[:, self.parts.chassis]
        cosine, sine = heading.cos(), heading.sin()
        return torch.stack(
            [
                cosine * v[:, 0] + sine * v[:, 1],
                cosine * v[:, 1] - sine * v[:, 0],
                self._omega[:, self.parts.chassis, 2],
            ],
            dim=1,
        )

    def upset(self) -> torch.Tensor:
        """Return (W,) bool: the chassis leans more than 60 degrees."""
        x, y, _, _ = self._rotation[:, self.parts.chassis].unbind(dim=1)
        return 1.0 - 2.0 * (x * x + y * y) < 0.5


def quat_product(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Return the product of quaternions xyzw, broadcast."""
    ax, ay, az, aw = a.unbind(dim=-1)
    bx, by, bz, bw = b.unbind(dim=-1)
    return torch.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        dim=-1,
    )


def turned_vector(rotation: torch.Tensor, vector: torch.Tensor) -> torch.Tensor:
    """Return vectors (W, 3) of a body's axes in those of the world; rotations (W, 4) xyzw."""
    axis, scalar = rotation[:, :3], rotation[:, 3:]
    twice = 2.0 * torch.linalg.cross(axis, vector, dim=1)
    return vector + scalar * twice + torch.linalg.cross(axis, twice, dim=1)


def to_vehicle(point: torch.Tensor, heading: torch.Tensor, place: torch.Tensor) -> torch.Tensor:
    """Return world points (W, N, 2) relative to a vehicle at `place` (W, 2), in axes of its heading (W,)."""
    away = (point - place.unsqueeze(1)).float()
    cosine, sine = heading.cos().unsqueeze(1), heading.sin().unsqueeze(1)
    return torch.stack(
        [cosine * away[..., 0] + sine * away[..., 1], cosine * away[..., 1] - sine * away[..., 0]], dim=2
    )
