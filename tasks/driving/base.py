"""Base of all driving tasks: a vehicle that the policy drives, its placement, its sensors, its collisions."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, TypeVar

import numpy as np
import torch
import warp as wp

import simwarp as sw

from ..framework.agents import beside
from ..framework.errors import InputError, TaskError
from ..framework.recorded_launches import TensorFunction, WorldLaunch, filled, launch_over, share_over, zeros_of
from ..framework.task import Task
from ..framework.task_simulation import Attachments
from . import base_kernels as kernels
from .camera_images import CameraImages
from .conditions import DrawnConditions, middle, set_middle_mass
from .driven_vehicles import CHASSIS_GROUP, HMMWV, OWN_MEASURES, VEHICLE_ARRAYS, VehicleChoiceConfig, settling_time
from .driving_config import DrivingConfig, Observing
from .navigation import Navigation
from .navigation_kernels import Navigator
from .soil import DrivenSoil, SoilKind
from .tire_ground import CONTACT_ARRAYS, TIRE_GROUP, add_flat_ground, stands_on_shapes
from .training_defaults import PEDALS_BY_CAMERA, PEDALS_BY_LIDAR

DrivingT = TypeVar("DrivingT", bound=DrivingConfig)


def _name(agent: int) -> str:
    """Return what follows a name that belongs to one of several agents; of the first, or a single one, nothing."""
    return f" {agent}" if agent else ""


class DrivingTask(Task[DrivingT]):
    """A task whose actions are steering (positive to the left) and the pedals (positive throttle, negative brake).

    A subclass writes `build_world`, `draw_world`, `start`, what is `measured`, the `exact_state`, and the rewards and
    terminations of its own. Observations are `policy`, a vector (W, N) float32, and beside it by camera `camera`, an
    image (W, height, width, 3) uint8, by lidar `lidar`, a range image (W, rows, columns, 1) float32. All arrays are of
    the task's device; W is the number of worlds.
    """

    fused_physics: ClassVar[bool] = True
    action_size: int = 2
    """2: steering and pedals; 1: steering alone, and the task works the pedals (`vehicle.input`)."""
    per_world: ClassVar[tuple[str, ...]] = VEHICLE_ARRAYS
    """Model parameters that differ by world. A subclass that adds its own keeps these two, which vehicles write."""
    state_buffers: ClassVar[Mapping[str, str]] = {"difficulty": "difficulty"}
    """A subclass that adds its own keeps this one, by which worlds are drawn."""
    training_by_obs: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "state": {"network.hidden": (128, 64)},
        "camera": PEDALS_BY_CAMERA,
        "lidar": PEDALS_BY_LIDAR,
    }
    """Defaults of training by the value of ``obs``, beside those of `training`. By camera and by lidar a policy begins
    with 0.3 of the throttle; that of a class with ``action_size = 1``, which works no pedals, straight ahead. A class
    that says none for the lidar has those of this one."""
    vehicle_name: ClassVar[str] = HMMWV.vehicle_name
    """Vehicle that is driven: a name of `simwarp.vehicle.vehicle_names()` or a path of a vehicle's JSON file."""
    missing_measures: ClassVar[tuple[str, ...]] = ()
    """Measures that a class with a `vehicle_name` of its own does not say beside it."""
    full_name: ClassVar[str] = HMMWV.full_name
    """Vehicle that is driven with the field ``full``; the same name where there is one model only."""
    tire: ClassVar[str | None] = HMMWV.tire
    """Name of its tires among those that the vehicle's description offers; None: those of the description."""
    chassis_half: ClassVar[tuple[float, float, float]] = HMMWV.chassis_half
    """Half lengths (x, y, z) of the box that stands for the chassis in contacts [m]."""
    chassis_place: ClassVar[tuple[float, float, float]] = HMMWV.chassis_place
    """Middle of that box in the vehicle's frame of reference: X ahead, Y left, Z up [m]."""
    camera_place: ClassVar[tuple[float, float, float]] = HMMWV.camera_place
    """Place of the policy's camera or lidar in the vehicle's frame of reference [m]; it looks ahead, along +X."""
    contact_mask: ClassVar[int] = TIRE_GROUP
    """Groups that the ground's shape meets where the vehicle stands on shapes: those of its tires, or its shoes."""
    looks_like: ClassVar[str | None] = None
    """Name of a shipped vehicle whose body it is seen with, in its own size; None: its own body if it is one of them,
    else the box of its chassis on wheels."""
    navigates: ClassVar[bool] = False
    """Beside a camera or a lidar there are a satellite receiver and a gyroscope, the only other instruments of the
    vehicle."""
    view_distance: ClassVar[float] = 9.0
    """Scale of the view of pictures for people [m]: the eye is 1.5 times this behind the chassis and 0.36 above it."""

    parts: sw.vehicle.VehicleParts
    """Indices of the vehicle's bodies and joints in the model: `parts.chassis` is what a sensor is mounted on; from
    `build` on."""
    vehicle: sw.vehicle.Vehicle
    """The vehicle at work: its inputs, tires, gear and motion; from `attach` on."""
    camera: sw.sensors.Camera | None
    """The policy's camera, of several agents the first one's; None with other ``obs``. From `attach` on."""
    cameras: list[sw.sensors.Camera]
    """Those of all agents; empty with other ``obs``. From `attach` on."""
    lidar: sw.sensors.Lidar | None
    """The policy's lidar; None with other ``obs``. From `attach` on."""
    images: CameraImages | None
    """What the policy sees by its camera: light, fog and noise in it; None with other ``obs``. From `setup` on."""
    conditions: DrawnConditions
    """Friction, light, fog, contrast and noise of the running episodes; from `setup` on."""
    soil: DrivenSoil | None
    """The soil below the wheels; None on rigid ground. From `attach` on."""
    navigations: list[Navigation]
    """Those of all agents; empty where there is no `navigation`. From `attach` on."""
    navigation: Navigation | None
    """Of the first agent: receiver and gyroscope where the task `navigates` and has a camera or a lidar, else None;
    from `attach` on."""
    difficulty: torch.Tensor
    """(W,) float32 in [0, 1]: curriculum level of the running episodes; from `setup` on."""
    hit: torch.Tensor
    """(W,) bool: the box of the chassis touched something in this control step; from `setup` on."""

    def __init_subclass__(cls, **options: Any) -> None:
        """Note measures that lack beside a `vehicle_name`; a class that steers alone begins without throttle."""
        super().__init_subclass__(**options)
        own = vars(cls)
        if "vehicle_name" in own:
            cls.missing_measures = tuple(name for name in OWN_MEASURES if name not in own)
        if own.get("action_size") == 1 and "training_by_obs" not in own:
            straight = {"network.init_mean": (0.0,)}
            seeing = {obs: {**cls.training_by_obs[obs], **straight} for obs in ("camera", "lidar")}
            cls.training_by_obs = {**cls.training_by_obs, **seeing}
        elif "lidar" not in cls.training_by_obs:
            mean = cls.training_by_obs.get("camera", {}).get("network.init_mean", PEDALS_BY_LIDAR["network.init_mean"])
            cls.training_by_obs = {**cls.training_by_obs, "lidar": {**PEDALS_BY_LIDAR, "network.init_mean": mean}}

    def __init__(self, config: DrivingT, num_worlds: int, **options: Any) -> None:
        if isinstance(config, VehicleChoiceConfig) and (chosen := config.driven()) is not None:
            vars(self).update(vars(chosen))  # the class's are those of the task's own vehicle
        super().__init__(config, num_worlds, **options)

    @property
    def sees_alone(self) -> bool:
        """There is a camera, and nothing is observed beside its image."""
        return self.camera is not None and self.config.images_alone

    @property
    def sensor(self) -> sw.sensors.Camera | sw.sensors.Lidar | None:
        """The policy's camera or lidar; None with ``obs`` state."""
        return self.camera or self.lidar

    @property
    def throttle_alone(self) -> bool:
        """The second action is throttle from end to end, none at -1, and there is no brake."""
        return False

    @property
    def action_names(self) -> Sequence[str]:
        """Steering, and pedals where the policy works them."""
        return ("steering", "pedals")[: self.action_size]

    # ---- what a subclass may write -------------------------------------------------------------------------------

    def build_world(self, builder: sw.ModelBuilder) -> None:
        """Add the shapes of one world to the builder: obstacles, walls. Optional; needs no ``super()``.

        The vehicle is there already, at the origin. Tires roll on `ground`, not on these shapes; rigid and flexible
        ones on what `add_ground` adds, and on those of these shapes that meet group 1.
        """

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Show the vehicle instead of the box that stands for it. Subclasses call ``super()`` first, then add world and
        ground: only what stands in `build_world` is seen otherwise, and the ground of tires is not.
        """
        self.show_vehicle(visuals)

    def show_vehicle(self, visuals: sw.sensors.Visuals) -> None:
        """Show the vehicle; a class with another kind of vehicle than one on wheels writes its own."""
        sw.scenery.add_vehicle_visual(visuals, self.parts, like=self.looks_like, box=self.chassis_shape)

    def draw_world(self, world_mask: torch.Tensor) -> None:
        """Draw what differs in a new episode's world: from ``self.random`` and ``self.difficulty`` alone. Optional;
        needs no ``super()``.

        A run that is resumed draws the worlds of its episodes again.

        Args:
            world_mask: (W,) bool, the worlds that begin an episode; nothing changes in others.
        """

    @abstractmethod
    def start(self, world_mask: torch.Tensor) -> None:
        """Put the vehicle where it starts, with ``place_vehicle``. It stands settled at the origin, facing +X, before.

        Args:
            world_mask: (W,) bool, the worlds that begin an episode; nothing changes in others.
        """

    @abstractmethod
    def measured(self) -> torch.Tensor:
        """Return (W, N) float32, measurements of the vehicle: the observations ``policy`` beside a camera.

        Of the order of 1 where a network is to learn from them.
        """

    @abstractmethod
    def exact_state(self) -> torch.Tensor:
        """Return (W, N) float32, exact relative positions and motion: the observations ``policy`` without a camera.

        By camera the critic sees them in training (``--network.critic privileged``).
        """

    def end_step(self) -> None:
        """Called after the physics of a control step, before rewards. Optional; needs no ``super()``."""

    def record_world(self) -> None:
        """Record launches that read or write what is seen; called once, and again when a scene is bound. Optional."""

    def seen_per_world(self) -> Sequence[str]:
        """Return the names of the arrays of `Scene` that differ by world, such as ``("x", "color")``; by default none.

        Those that a subclass writes in `draw_world` are named here.
        """
        return ()

    def ground(self, model: sw.Model) -> Any:
        """Return the tires' terrain (`simwarp.vehicle.ground`); None is the plane z = 0."""
        return None

    def add_ground(self, builder: sw.ModelBuilder) -> int:
        """Add the shape that rigid and flexible tires stand on, and return its index; by default the plane z = 0.

        Called after `build_world`, with such tires alone. A class with a `ground` of its own adds that.
        """
        return add_flat_ground(builder, mask=self.contact_mask)

    def more_elements(self, model: sw.Model) -> list[Any]:
        """Return force elements that come before the vehicle, such as a speed controller that writes its input. Called
        by `attach`, once ``self.vehicle`` is there. Optional; needs no ``super()``.
        """
        return []

    # ---- the machinery -------------------------------------------------------------------------------------------

    def build(self, builder: sw.ModelBuilder) -> None:
        """Add the vehicle at the origin, facing +X, then the world's shapes."""
        self._check_vehicle()
        self.add_vehicle(builder)
        self.chassis_shape = sw.vehicle.add_chassis_box(
            builder, self.parts, half=self.chassis_half, position=self.chassis_place, group=CHASSIS_GROUP
        )
        self._build_ground(builder)

    def add_vehicle(self, builder: sw.ModelBuilder) -> None:
        """Add the vehicle that is driven, and store its ``spec`` and ``parts``."""
        self.spec = self.make_spec()
        self.parts = sw.vehicle.add_vehicle(builder, self.spec)

    def _build_ground(self, builder: sw.ModelBuilder) -> None:
        """Add the world's shapes, and what tires in contact stand on."""
        self.build_world(builder)
        on_soil = self.config.soil is not SoilKind.NONE
        self._tire_ground = None if on_soil or not self.stands_on_shapes else self.add_ground(builder)
        self._builder = builder
        self._scene: sw.sensors.Scene | None = None

    @property
    def stands_on_shapes(self) -> bool:
        """What the vehicle rolls on meets shapes in contact, which need a shape below them: `add_ground`'s."""
        return stands_on_shapes(self.make_spec())

    @property
    def own_parameters(self) -> frozenset[str]:
        """Return the names of `per_world`, and of what tires in contact write."""
        contact = CONTACT_ARRAYS if self.stands_on_shapes else ()
        return super().own_parameters.union(contact)

    def _check_vehicle(self) -> None:
        """Refuse a vehicle of a subclass's own with measures of its parent's.

        Raises:
            InputError: some of them are missing.
        """
        if self.missing_measures:
            raise InputError(
                f"task '{self.name}': beside a vehicle_name of its own must stand its {', '.join(OWN_MEASURES[1:])}, "
                f"got no {', '.join(self.missing_measures)}; write them beside vehicle_name = {self.vehicle_name!r}"
            )

    def make_spec(self) -> sw.vehicle.VehicleSpec:
        """Return the vehicle's description: the reduced or the full model, on this task's tires."""
        spec = sw.vehicle.load_vehicle(self.full_name if self.config.full else self.vehicle_name)
        tire = (self.config.tires or self.tire) if self.config.soil is SoilKind.NONE else "soil-rigid"
        return sw.vehicle.with_options(spec, tire=tire) if tire is not None else spec

    def make_vehicle(self, model: sw.Model, ground: Any) -> sw.vehicle.Vehicle | sw.vehicle.Vehicles:
        """Make ``self.vehicle``, the one that is driven, and return the force element: itself, or all alike it.

        Args:
            model: finished.
            ground: the tires' terrain; None is the plane z = 0.
        """
        self.vehicle = sw.vehicle.Vehicle(self.parts, model, ground=ground, randomised=True)
        return self.vehicle

    def ground_friction(self) -> wp.array:
        """Return the friction (W,) of the ground below the vehicle, which conditions write."""
        return self._driven.tires.ground_friction

    def make_soil(self, ground: Any) -> DrivenSoil | None:
        """Return the soil that comes after the vehicle as an element; None where there is none, or the vehicle has it.

        Args:
            ground: the undeformed ground; None is the plane z = 0.
        """
        config = self.config
        if config.soil is SoilKind.NONE:
            return None
        return DrivenSoil(
            self._driven, config.soil, self.random, ground=ground, friction=middle(config.friction),
            spacing=config.soil_spacing, pages=config.soil_pages, time=config.control_dt * config.max_episode_steps,
        )  # fmt: skip

    def settling(self) -> float:
        """Return the time in which the vehicle comes to rest before the first episode [s]."""
        return settling_time(self.parts)

    def attach(self, model: sw.Model) -> Attachments:
        """Return the vehicle, and the camera or lidar where there is one.

        A subclass with sensors of its own calls ``super()`` and returns the same elements with more sensors.
        """
        config = self.config
        ground = self.ground(model)
        self._driven = self.make_vehicle(model, ground)
        self.ground_friction().fill_(middle(config.friction))
        self.soil = self.make_soil(ground)
        below = [] if self.soil is None else [self.soil.element]
        seeing = self.seeing_parts()
        self.cameras = []
        if config.obs is Observing.CAMERA:
            self.cameras = [self._make_camera(model, parts, _name(at)) for at, parts in enumerate(seeing)]
        self.camera = self.cameras[0] if self.cameras else None
        seen = config.obs is Observing.LIDAR
        self.lidar = sw.sensors.Lidar(self._scene_of(model), self._mount(self.parts), config.lidar()) if seen else None
        sensors: list[Any] = [*self.cameras, *([] if self.lidar is None else [self.lidar])]
        self.navigations = []
        if sensors and self.navigates:
            timing = (config.dt, config.decimation, self.random)
            self.navigations = [Navigation(model, parts, *timing, _name(at)) for at, parts in enumerate(seeing)]
        self.navigation = self.navigations[0] if self.navigations else None
        for navigation in self.navigations:
            sensors += navigation.sensors
        return Attachments(elements=[*self.more_elements(model), self._driven, *below], sensors=sensors)

    def seeing_parts(self) -> Sequence[sw.vehicle.VehicleParts]:
        """Return the vehicles that have a camera and instruments, one for each agent; a single agent's is `parts`."""
        return (self.parts,)

    def _mount(self, parts: sw.vehicle.VehicleParts) -> sw.sensors.Mount:
        place = np.asarray(self.camera_place) + parts.reference
        return sw.sensors.Mount(body=parts.chassis, pose=sw.pose(place))

    def _make_camera(self, model: sw.Model, parts: sw.vehicle.VehicleParts, name: str) -> sw.sensors.Camera:
        lights = self.lighting()
        suns = len(lights.suns if lights is not None else sw.sensors.Lighting().suns)
        return sw.sensors.Camera(
            self._scene_of(model), self._mount(parts), self.config.camera(), lights=lights, name=f"camera{name}",
            per_world=self.config.camera_arrays(suns),
        )  # fmt: skip

    def scene(self) -> sw.sensors.Scene:
        """Return the scene of the camera and of pictures."""
        known = self._scene
        scene = self._scene_of(self.simulation.model)
        if known is None:
            self.bind_scene(scene)
            self.record_world()
            self._record_physics()
            self.draw_world(torch.ones(self.num_worlds, dtype=torch.bool, device=self.device))
        return scene

    def shot(self) -> sw.viewer.Shot:
        """From behind and above, so that what is ahead of the vehicle is in sight."""
        far = self.view_distance
        eye, target = (-1.5 * far, -0.25 * far, 0.36 * far), (0.55 * far, 0.0, 0.0)
        return sw.viewer.Shot(body=self.parts.chassis, target=target, eye=eye, fov=1.0, turns=True)

    def bind_scene(self, scene: sw.sensors.Scene) -> None:
        """Make views of what differs by world in what is seen; `draw_world` writes them. Optional.

        Needs no ``super()``. Called by `setup` where there is a camera, else when pictures are taken first, or never.
        """

    def _scene_of(self, model: sw.Model) -> sw.sensors.Scene:
        if self._scene is None:
            visuals = sw.sensors.Visuals(self._builder)
            if self._tire_ground is not None:
                visuals.hide(self._tire_ground)
            self.visuals(visuals)
            sw.viewer.paint(visuals)
            self._scene = visuals.finalize(model, per_world=self.seen_per_world(), origin_body=self.parts.chassis)
            if self.soil is not None:
                self.soil.show_in(self._scene)
        return self._scene

    def solver_options(self) -> sw.SolverOptions:
        """A vehicle's rows need no projection: joints stay together by themselves."""
        return sw.vehicle.VEHICLE_SOLVER

    def setup(self) -> None:
        """Let the vehicle settle on its springs, store the positions of its bodies, record what a step launches.

        A subclass calls ``super()`` first, then makes its buffers.
        """
        self.input = sw.to_torch(self._driven.input)
        friction = sw.to_torch(self.ground_friction()) if self.config.soil is SoilKind.NONE else None
        self._camera_images = [
            CameraImages(camera, self.simulation, self.random, _name(at)) for at, camera in enumerate(self.cameras)
        ]
        self.images = self._camera_images[0] if self._camera_images else None
        images = [sw.to_torch(camera.data) for camera in self.cameras]
        self._all_images = torch.stack(images, dim=1) if len(images) > 1 else None
        self._ranges = None if self.lidar is None else sw.to_torch(self.lidar.ranges)
        self.conditions = DrawnConditions(
            self.config, self.random, self.num_worlds, friction, self._camera_images, self.device
        )  # fmt: skip
        self._settle()
        state = self.simulation.state
        bodies = sw.to_torch(self.vehicle.bodies).long()
        places, turns = (sw.to_torch(array)[0, bodies].contiguous() for array in (state.body_x, state.body_rot))
        start_x, start_rot = wp.from_torch(places, dtype=wp.vec3d), wp.from_torch(turns, dtype=wp.quatd)
        pulled = sw.vehicle.trailer_boxes(self._builder, self.parts)
        self._car = filled(
            kernels.Car, chassis=self.parts.chassis, shape=self.chassis_shape,
            trailer_shapes=wp.array(pulled, dtype=int, device=self.simulation.model.device),
            reference=wp.vec3d(*self.parts.reference), bodies=self.vehicle.bodies, start_x=start_x, start_rot=start_rot,
            force=self.simulation.contacts.shape_contact_force, input=self.vehicle.input,
            throttle_alone=int(self.throttle_alone),
        )  # fmt: skip
        self._drive = zeros_of(kernels.Drive, self)
        self.difficulty = sw.to_torch(self._drive.difficulty).fill_(1.0)
        """(W,) float32: of the running episodes, in [0, 1]."""
        self.hit = sw.to_torch(self._drive.hit)
        """(W,) bool: the chassis touched something in this control step."""
        self._record_vehicle()
        places[:, :2] -= self.pose()[0][0, :2]
        if self._scene is not None:
            self.bind_scene(self._scene)

    def _record_vehicle(self) -> None:
        """Record what every driving task launches."""
        car, drive, state, device = self._car, self._drive, self.simulation.state.arrays, self.device
        flag, point, turn = (torch.bool, ()), (torch.float64, (3,)), (torch.float32, ())
        self._measure_pose = TensorFunction(kernels.measure_pose, [car, state], [point, turn], device)
        self._measure_motion = TensorFunction(kernels.measure_motion, [car, state], [(torch.float32, (3,))], device)
        self._measure_tilt = TensorFunction(kernels.measure_tilt, [car, state], [(torch.float32, (2,))], device)
        self._find_upset = TensorFunction(kernels.find_upset, [car, state], [flag], device)
        self._navigator = Navigator() if self.navigation is None else self.navigation.tables
        self._place = TensorFunction(kernels.place_cars, [car, self._navigator, state], [], device)
        self._level_ground = torch.zeros(self.num_worlds, 3, dtype=torch.float64, device=device)
        self._level_ground[:, 2] = 1.0
        self._begin_drive = launch_over(self, kernels.begin_drive, drive)
        self._begin_drive_episode = launch_over(self, kernels.begin_drive_episode, self._every_world, self.level, drive)
        self._steer = launch_over(self, kernels.steer, self._actions, car)
        self._notice = launch_over(self, kernels.finish_physics, car, drive)

    def physics_launches(self) -> Sequence[WorldLaunch]:
        """Return what stands for `apply` and `after_physics`: the action's way, steering and pedals, and touches.

        Raises:
            TaskError: a subclass's setup() did not call this one's.
        """
        if not hasattr(self, "_car"):
            raise TaskError(f"task '{self.name}': its setup() must call super().setup() first; add that line")
        path = self._path
        arrays = (path.reach, path.request, self.action, self._car, self._drive)
        return [share_over(self.simulation, kernels.drive_on, *arrays)]

    def _settle(self) -> None:
        set_middle_mass(self.config, self.simulation.model)
        self.input.zero_()
        self.input[..., 2] = 1.0
        for _ in range(round(self.settling() / self.config.dt)):
            self.simulation.step()
        if self.soil is not None:
            self.soil.keep(sw.to_torch(self.simulation.state.body_x))
        self.input.zero_()
        self.simulation.keep_as_initial()

    def apply(self, action: torch.Tensor) -> None:
        """Write steering, throttle and brake from ``action`` (W, A) in [-1, 1]; not called but by an override."""
        self._steer.on(action)

    def reset(self, world_mask: torch.Tensor) -> None:
        """Draw a world and start in it where ``world_mask`` (W,) is true: subclasses write `draw_world` and `start`."""
        self._begin_drive_episode.on(world_mask)
        self.conditions.draw(world_mask)
        if self.soil is not None:
            self.soil.draw(world_mask)
        self.draw_world(world_mask)
        self.start(world_mask)
        if self.soil is not None:
            self.soil.press_in(world_mask)
            self.simulation.measure(world_mask, sensors=False)

    def observations(self) -> dict[str, torch.Tensor]:
        """Return ``policy`` (W, N) float32 and, by camera, ``camera`` (W, height, width, 3) uint8; by lidar ``lidar``
        (W, rows, columns, 1) float32, nearness: 1 at the sensor, 0 at ``lidar_range`` and where nothing is seen.

        ``policy`` is what is `measured` beside them, and the `exact_state` with ``obs`` state; with ``images_alone``
        there is no ``policy`` beside a camera.
        """
        if self._ranges is not None:
            nearness = 1.0 - self._ranges[..., :1] / self.config.lidar_range
            return {"policy": self.measured(), "lidar": nearness}
        if self.images is None:
            return {"policy": self.exact_state()}
        if self.config.images_alone:
            return {"camera": self.seen_images()}
        return {"policy": self.measured(), "camera": self.seen_images()}

    def seen_images(self) -> torch.Tensor:
        """Return the images (W, height, width, 3) uint8 that policies see, of several agents (W, N, ...); the buffer
        itself.
        """
        return beside([each.read() for each in self._camera_images], self._all_images)

    def privileged(self) -> torch.Tensor | None:
        """Return the `exact_state` (W, N) where the policy sees images; None where it sees that state itself."""
        return None if self.sensor is None else self.exact_state()

    def observations_of(self, obs: str | None) -> dict[str, torch.Tensor] | None:
        """Return the `exact_state` (W, N) beside a camera or lidar, as policies by state see it: they can teach."""
        return {"policy": self.exact_state()} if obs == Observing.STATE.value else None

    def begin_step(self) -> None:
        """Clear the touches of the step before. A subclass calls ``super()`` first."""
        self._begin_drive.launch()

    def after_physics(self) -> None:
        """Notice a touch that may be over before the control step is. A subclass calls ``super()`` first."""
        self._notice.launch()

    def finish_physics(self) -> None:
        """Notice the last touch, read the instruments, and end the step."""
        self._notice.launch()
        for navigation in self.navigations:
            navigation.advance()
        self.end_step()

    def extra_state(self) -> dict[str, torch.Tensor]:
        """Return the ``difficulty`` (W,) of the running episodes, from which their worlds are drawn, and, where there
        are `navigations`, the ``heading`` (W,) of each [rad]. A subclass adds its own to what ``super()`` returns.
        """
        return super().extra_state() | {
            f"heading{_name(at)}": navigation.heading for at, navigation in enumerate(self.navigations)
        }

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Take back what `extra_state` returned, name -> (W,), and draw the worlds of the running episodes again.

        A subclass calls ``super()`` first.
        """
        super().load_extra_state(state)
        for at, navigation in enumerate(self.navigations):
            navigation.heading.copy_(state[f"heading{_name(at)}"])
        self.conditions.draw(self._every_world)
        if self.soil is not None:
            self.soil.draw(self._every_world)
        self.draw_world(torch.ones(self.num_worlds, dtype=torch.bool, device=self.device))

    # ---- where the vehicle is ------------------------------------------------------------------------------------

    def place_vehicle(
        self, world_mask: torch.Tensor, place: torch.Tensor, heading: torch.Tensor,
        normal: torch.Tensor | None = None,
    ) -> None:  # fmt: skip
        """Put the settled vehicle, at rest, on the ground where ``world_mask`` (W,) is true.

        Args:
            world_mask: only these worlds change.
            place: (W, 3) the point of the ground below its reference point, world [m].
            heading: (W,) direction of its x axis seen from above, from +X towards +Y [rad].
            normal: (W, 3) unit vectors upwards from the ground there; None: level ground.
        """
        normals = self._level_ground if normal is None else normal.double()
        self._place(world_mask, place.double().contiguous(), heading.double(), normals.contiguous())
        self.simulation.measure(world_mask, sensors=False)

    def pose(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the reference point, (W, 3) float64, world [m], and the heading, (W,) float32 in [-pi, pi] [rad]."""
        point, heading = self._measure_pose(shape=(self.num_worlds,))
        return point, heading

    def motion(self) -> torch.Tensor:
        """Return (W, 3) float32: speed ahead and to the left [m/s], yaw rate [rad/s], in axes of the heading."""
        return self._measure_motion(shape=(self.num_worlds,))[0]

    def tilt(self) -> torch.Tensor:
        """Return (W, 2) float32: how far the chassis' axes ahead and to the left rise, as sines; 0 on level ground."""
        return self._measure_tilt(shape=(self.num_worlds,))[0]

    def upset(self) -> torch.Tensor:
        """Return (W,) bool: the chassis leans more than 60 degrees."""
        return self._find_upset(shape=(self.num_worlds,))[0]
