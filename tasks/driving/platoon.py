"""Convoy of simulated vehicles: a driver takes those at the head along the path, policies drive those that follow.

All are in one world: they push each other, and followers drive in their leaders' ruts. Each follower sees what the
policy of `convoy` saw of its ghosts: places of the three vehicles ahead. Where there are fewer, the schedule of the
path stands for those ahead of the first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import torch
import warp as wp

import simwarp as sw

from ..framework.agents import lead_of
from ..framework.drawing import Line
from ..framework.recorded_launches import TensorLaunch, WorldLaunch, filled, launch_over, share_over
from .convoy import ConvoyTask
from .convoy_kernels import Platoon
from .driven_vehicles import CHASSIS_GROUP, SETTLING
from .outlines import outline
from .platoon_kernels import (
    Touches,
    begin_driver,
    begin_platoon,
    count_touches,
    drive_platoon,
    finish_platoon,
    notice_platoon,
    pace_driver,
    start_heading,
    start_platoon,
    steer_platoon,
)

APART = 8.0
"""Distance at which vehicles settle beside each other [m]."""
BRAKE = (0.0, -1.0)
"""What a follower that is done asks for."""


class PlatoonTask(ConvoyTask):
    """`convoy` with leaders that are vehicles; with several followers, an agent each.

    Observations: those of `ConvoyTask` for each of N followers, ``policy`` (W, N, 34) or, by camera, ``policy``
    (W, N, 6) and ``camera`` (W, N, height, width, 3); of a single one (W, ...).

    Attributes:
        vehicles: all of them, from the head of the convoy to its tail.
        deviation: (W, V) float32, each vehicle's mean distance from the path in its episode [m].
        touched: (W, V) bool, the chassis touched something in the last control step.
        touches: (W, N, 2) int32, with ``drive_on`` the touches of each follower in its episode: of obstacles, and of
            vehicles ahead.
    """

    name: ClassVar[str] = "convoy"
    resting_action: float | Sequence[float] = BRAKE
    state_buffers: ClassVar[Mapping[str, str]] = {**ConvoyTask.state_buffers, "deviation": "deviation"}

    vehicles: sw.vehicle.Vehicles
    deviation: torch.Tensor
    touched: torch.Tensor
    touches: torch.Tensor

    @property
    def agents(self) -> int:  # type: ignore[override]
        """Number of followers, which policies drive."""
        followers: int = self.config.followers
        return followers

    # ---- the world -----------------------------------------------------------------------------------------------

    def build(self, builder: sw.ModelBuilder) -> None:
        """Add the vehicles, side by side, then the world's shapes."""
        self._check_vehicle()
        self.spec = self.make_spec()
        count = self.config.leading + self.config.followers
        places = [sw.pose((0.0, APART * index, self.spec.start_height)) for index in range(count)]
        self._parts = [
            sw.vehicle.add_vehicle(builder, self.spec, at=place, prefix=f"v{index}_")
            for index, place in enumerate(places)
        ]
        self._boxes = [
            sw.vehicle.add_chassis_box(
                builder, parts, half=self.chassis_half, position=self.chassis_place, group=CHASSIS_GROUP
            )
            for parts in self._parts
        ]
        self.parts, self.chassis_shape = self._parts[-1], self._boxes[-1]
        self._build_ground(builder)

    def seeing_parts(self) -> Sequence[sw.vehicle.VehicleParts]:
        """Return the followers."""
        return self._parts[self.config.leading :]

    def make_vehicle(self, model: sw.Model, ground: Any) -> sw.vehicle.Vehicles:
        """Make all vehicles; ``vehicle`` is the last one."""
        self.vehicles = sw.vehicle.Vehicles(self._parts, model, ground=ground, randomised=True)
        self.vehicle: sw.vehicle.Vehicle = self.vehicles[-1]
        return self.vehicles

    def more_elements(self, model: sw.Model) -> list[Any]:
        """Return the drivers of the vehicles at the head."""
        # Until it has settled a vehicle stands on its brakes
        spec = sw.vehicle.PathTrackingSpec(
            paths=tuple(self.ways()[0]), speed=0.0, steering=sw.vehicle.look_ahead_for(self.spec), start=SETTLING
        )
        self._drivers: list[sw.vehicle.PathTracker] = [
            sw.vehicle.PathTracker(self.vehicles[index], spec) for index in range(self.config.leading)
        ]
        return [*super().more_elements(model), *self._drivers]

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Show what `convoy` shows, vehicles in place of leaders."""
        self._has_body = sw.scenery.has_body(self.looks_like or self.spec.name)
        if self._has_body:
            visuals.hide(*self._boxes[:-1])  # before others note the indices of what they add: those behind move up
        super().visuals(visuals)

    def show_leading(self, visuals: sw.sensors.Visuals) -> None:
        """Show the other vehicles."""
        for parts, box in zip(self._parts[:-1], self._boxes[:-1], strict=True):
            sw.scenery.add_vehicle_visual(
                visuals, parts, like=self.looks_like, color=(0.5, 0.05, 0.03), box=None if self._has_body else box
            )

    def bind_scene(self, scene: sw.sensors.Scene) -> None:
        """Show obstacles; the vehicles are bodies."""
        self.obstacles.bind_scene(scene)

    def _record_vehicle(self) -> None:
        """Record what every driving task launches, and how the vehicles stand."""
        super()._record_vehicle()
        model, worlds, device = self.simulation.model, self.num_worlds, self.device
        state, vehicles = self.simulation.state, self.vehicles
        owner = np.full(model.body_count, -1, np.int32)
        x = state.body_x.numpy()[0].copy()
        for index, (vehicle, point) in enumerate(zip(vehicles, vehicles.position.numpy()[0], strict=True)):
            bodies = vehicle.bodies.numpy()
            owner[bodies] = index
            x[bodies, :2] -= point[:2]
        self.deviation = torch.zeros(worlds, len(self._parts), device=device)
        self.touched = torch.zeros(worlds, len(self._parts), dtype=torch.bool, device=device)
        self._platoon = filled(
            Platoon,
            leading=self.config.leading,
            chassis=vehicles.chassis,
            shape=wp.array(self._boxes, dtype=int, device=str(device)),
            reference=wp.vec3d(*self.parts.reference),
            vehicle_of=wp.array(owner, dtype=int, device=str(device)),
            start_x=wp.array(x, dtype=wp.vec3d, device=str(device)),
            start_rot=wp.clone(state.body_rot[0]),
            force=self.simulation.contacts.shape_contact_force,
            input=vehicles.input,
            hit=self.touched,
            deviation=self.deviation,
        )
        self.touches = torch.zeros(worlds, self.agents, 2, dtype=torch.int32, device=device)
        self._touching = torch.zeros_like(self.touches, dtype=torch.bool)
        counted = {"count": self.touches, "last": self._touching} if self.config.drive_on else {}
        self._touches = filled(Touches, **counted)
        self._steer_all = launch_over(self, steer_platoon, self._actions, self._platoon)
        self._clear = launch_over(self, begin_platoon, self._platoon)
        self._notice_all = launch_over(self, notice_platoon, self._platoon)

    def _record_driving(self) -> None:
        """Record what places the vehicles, and what is launched while they drive."""
        column, routes, follow, platoon = self.column, self.routes.tables, self.follow, self._platoon
        state, every = self.simulation.state.arrays, self._every_world
        self._start = launch_over(self, start_platoon, every, state, routes, follow, platoon, self._touches)
        self._start_headings = [
            launch_over(self, start_heading, every, agent, navigation.tables, routes, follow, platoon)
            for agent, navigation in enumerate(self.navigations)
        ]
        counted = [column, state, routes, follow, platoon, self._touches]
        self._count_touches = TensorLaunch(count_touches, (self.num_worlds, self.agents), counted, self.device)
        self._finish = launch_over(self, finish_platoon, column, state, routes, follow, platoon)
        self._begin_drivers = [
            launch_over(self, begin_driver, every, follow, driver.path, driver.memory["segment"])
            for driver in self._drivers
        ]
        self._pace = [
            launch_over(self, pace_driver, index, column, state, routes, follow, platoon, driver.target_speed)
            for index, driver in enumerate(self._drivers)
        ]

    # ---- an episode ----------------------------------------------------------------------------------------------

    def start(self, world_mask: torch.Tensor) -> None:
        """One behind the other on the path."""
        self._start.on(world_mask)
        for begin in (*self._start_headings, *self._begin_drivers):
            begin.on(world_mask)
        self.simulation.measure(world_mask, sensors=False)

    def apply(self, action: torch.Tensor) -> None:
        """Write steering, throttle and brake of the followers from ``action`` (W, N, 2) in [-1, 1]."""
        self._steer_all.on(action.reshape(self.num_worlds, -1))

    def physics_launches(self) -> Sequence[WorldLaunch]:
        """Return the actions' way, steering and pedals, and touches."""
        path = self._path
        moved = [path.reach, path.request, self._actions, self._drive, self._platoon]
        return [share_over(self.simulation, drive_platoon, *moved)]

    def begin_step(self) -> None:
        """Clear the touches of the step before, and tell the drivers how fast to go."""
        super().begin_step()
        self._clear.launch()
        for pace in self._pace:
            pace.launch()

    def after_physics(self) -> None:
        """Notice touches that may be over before the control step is."""
        self._notice_all.launch()

    def end_step(self) -> None:
        """Notice the last touch, and store the distances from the path."""
        self._finish.launch()
        if self.config.drive_on:
            self._count_touches.launch()

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return what `convoy` does; with ``drive_on`` ``obstacle_hits`` counts those of the episode, and ``bumps`` the
        touches of vehicles ahead.
        """
        found = super().metrics()
        if self.config.drive_on:
            hits, bumps = self.touches.view(*lead_of(self), 2).float().unbind(-1)
            found |= {"obstacle_hits": hits, "bumps": bumps}
        return found

    def extra_state(self) -> dict[str, torch.Tensor]:
        """Return what `convoy` does and, with ``drive_on``, the touches (W, N, 2) and which of them last."""
        counted = {"touches": self.touches, "touching": self._touching} if self.config.drive_on else {}
        return super().extra_state() | counted

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Load what `convoy` has, and touches; the drivers' memory is the simulation's."""
        super().load_extra_state(state)
        if self.config.drive_on:
            self.touches.copy_(state["touches"])
            self._touching.copy_(state["touching"])
        for begin, driver in zip(self._begin_drivers, self._drivers, strict=True):
            segment = driver.memory["segment"].numpy()
            begin.on(self._every_world)
            driver.memory["segment"].assign(segment)

    # ---- pictures ------------------------------------------------------------------------------------------------

    def vehicle_lines(self) -> list[Line]:
        """Return the vehicles' outlines, those that followers drive in orange."""
        points, angles = sw.to_torch(self.vehicles.position), sw.to_torch(self.vehicles.angles)
        colors = ["tab:red"] * self.config.leading + ["tab:orange"] * self.config.followers
        return [
            Line(outline(points[:, index], angles[:, index, 2], self.chassis_half), color, 2.0, only_maps=True)
            for index, color in enumerate(colors)
        ]
