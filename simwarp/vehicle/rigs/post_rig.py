"""A vehicle on posts, one below each wheel, in every world: the rig of four-post and tilt-table runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.object_repr import Readable, plural
from simwarp.core.types import WorldStatus, pose
from simwarp.kernels.collision.shape import Assets
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.attachments import ForceElement, StepContext
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.rigs.posts_kernels import push_posts
from simwarp.vehicle.rigs.rig_rows import Reasons, no_reasons
from simwarp.vehicle.rigs.tire_rig import rig_vector
from simwarp.vehicle.spec.parts import Array, SpecError
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.tires.parameter_vector_kernels import BRISTLE_STATES
from simwarp.vehicle.tires.tires import Mount, Tires, ground
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

BELOW: Final = -1.0e4
"""Level of the plane that the vehicle's own tires would touch [m]: the posts take their place."""
HELD: Final = 20.0
"""Friction between tires and posts, over that on which a tire was measured: wheels lift before they slide."""
SLIDING: Final = 1.0e-3
"""The same of posts on which patches slide aside, as those of a wheel that rolls do when its track changes."""


class Posts(ForceElement):
    """Posts below the wheels of a vehicle, a `ForceElement` that comes after it and takes the place of its tires.

    Args:
        vehicle: whose wheels stand on them; its brakes should hold the wheels.
        grip: ratio of their friction to that on which a tire was measured.

    Attributes:
        height: (W, wheels) of the posts [m]; write it.
        speed: (W, wheels) of the posts upwards [m/s]; write it with the height.
        load: (W, wheels) vertical forces [N].

    Raises:
        SpecError: a tire makes no forces of its own.
    """

    def __init__(self, vehicle: Vehicle, *, grip: float = HELD) -> None:
        if not 0.0 < grip < 1e6:
            raise SpecError(f"grip: must be above 0 and below 1e6, got {grip:g}; 1 is a tire's usual road")
        self.grip = grip
        model, sides = vehicle.model, vehicle.parts.sides
        vectors = [rig_vector(vehicle.parts.spec.all_axles[side.axle].tire) for side in sides]
        mounts = [Mount(vector, side.spindle) for vector, side in zip(vectors, sides, strict=True)]
        self._tires = Tires(mounts, model.world_count, model.body_count, model.device)
        shape = (model.world_count, len(sides))
        self._spindles = tuple(side.spindle for side in sides)
        self._bristles: wp.array = wp.zeros((*shape, BRISTLE_STATES), dtype=float, device=model.device)
        self.height: wp.array = wp.zeros(shape, dtype=float, device=model.device)
        self.speed: wp.array = wp.zeros(shape, dtype=float, device=model.device)
        self.load: wp.array = wp.zeros(shape, dtype=float, device=model.device)

    def _readable_title(self) -> str:
        return f" below {plural(len(self._spindles), 'wheel')}"

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """Places of the posts and deflections of the tires' bristles."""
        return {"height": self.height, "speed": self.speed, "bristles": self._bristles}

    @property
    def assigned_bodies(self) -> tuple[int, ...]:
        """The wheels."""
        return self._spindles

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch of all posts' forces."""
        control = simulation.control.arrays
        return [
            simulation.shares.record(
                push_posts, len(self._spindles),
                inputs=[
                    dt, self._tires.tables, self._tires.parameter, self.grip, self._tires.terrain, Assets(),
                    self.height, self.speed, simulation.state.arrays, self._bristles,
                ],
                outputs=[self.load, control.element_force, control.element_torque],
            )
        ]  # fmt: skip


class PostRig(Readable):
    """A vehicle that stands on posts with its brakes on, in W worlds.

    Args:
        spec: the vehicle.
        worlds: W.
        dt: time step [s].
        grip: ratio of the posts' friction to that on which a tire was measured.
        device: that runs it.

    Attributes:
        simulation: of all worlds.
        vehicle: on the posts.
        posts: below its wheels.
        spindles: bodies of its wheels.
        mass: of the vehicle [kg].
        reason: (W,) why worlds broke down, as `watch` found it; empty of the others.

    Raises:
        SpecError: a tire makes no forces of its own, or the step is not usable.
    """

    def __init__(
        self, spec: VehicleSpec, worlds: int, *, dt: float = 1.0e-3, grip: float = HELD, device: str = "cpu"
    ) -> None:
        if not 0.0 < dt <= 0.01:
            raise SpecError(f"dt: must be above 0 and at most 0.01 s for a vehicle on posts, got {dt:g}")
        builder = ModelBuilder()
        parts = add_vehicle(builder, spec, at=pose((0.0, 0.0, self._start(spec))))
        model = builder.finalize(worlds, device, per_world=per_world(["gravity"]))
        self.vehicle = Vehicle(parts, model, ground=ground(model.device, x=(0.0, 0.0, BELOW)))
        self.posts = Posts(self.vehicle, grip=grip)
        self.simulation = Simulation(model, dt, elements=[self.vehicle, self.posts], solver=VEHICLE_SOLVER)
        inputs = self.vehicle.input.numpy()
        inputs[:, 2] = 1.0
        self.vehicle.input.assign(inputs)
        self._mass = np.asarray(model.body_mass.numpy()[0], np.float64)[list(parts.bodies)]
        self._bodies = list(parts.bodies)
        self.spindles = [side.spindle for side in parts.sides]
        self.reason: Reasons = no_reasons(worlds)
        self.mass = float(self._mass.sum())

    @staticmethod
    def _start(spec: VehicleSpec) -> float:
        """Height of the frame of reference at which the first wheel touches its post [m]."""
        lows = [axle.location[2] + axle.suspension.spindle.com[2] - axle.tire.radius for axle in spec.all_axles]
        return -min(lows)

    def _readable_title(self) -> str:
        return f": '{self.vehicle.parts.spec.name}' in {plural(self.simulation.model.world_count, 'world')}"

    def tilt(self, angle: Array) -> None:
        """Turn gravity as on a table that is tilted about x by (W,) angles [rad], the left side upwards."""
        size = float(np.linalg.norm(self.vehicle.model.builder.gravity))
        fields: Any = self.simulation.model.parameters
        gravity = -size * np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=1)
        fields.gravity.assign(gravity.astype(np.float32))

    def move(self, height: Array, speed: Array) -> None:
        """Set the posts' (W, wheels) heights [m] and speeds upwards [m/s] for the next step."""
        self.posts.height.assign(height.astype(np.float32))
        self.posts.speed.assign(speed.astype(np.float32))

    def loads(self) -> Array:
        """(W, wheels) vertical forces [N]."""
        return np.asarray(self.posts.load.numpy(), np.float64)

    def centre_of_mass(self) -> Array:
        """(W, 3) of the whole vehicle, world [m]."""
        x = np.asarray(self.simulation.state.body_x.numpy()[:, self._bodies], np.float64)
        return np.asarray(np.einsum("b,wbi->wi", self._mass, x) / self.mass)

    def wheel_places(self) -> Array:
        """(W, wheels, 3) of the wheels' centres, world [m]."""
        return np.asarray(self.simulation.state.body_x.numpy()[:, self.spindles], np.float64)

    def chassis_motion(self) -> Array:
        """(W, 3) height of the chassis' centre of mass [m], roll and pitch (nose down) [rad]."""
        chassis = self.vehicle.parts.chassis
        height = np.asarray(self.simulation.state.body_x.numpy()[:, chassis, 2], np.float64)
        x, y, z, w = np.asarray(self.simulation.state.body_rot.numpy()[:, chassis], np.float64).T
        roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
        return np.stack([height, roll, pitch], axis=1)

    def suspension_travel(self) -> Array:
        """(W, wheels) of the wheels' centres along the vertical axis of the chassis that they carry, from its centre of
        mass [m].
        """
        parts = self.vehicle.parts
        chassis = [parts.unit_of(side.axle).chassis for side in parts.sides]
        place = np.asarray(self.simulation.state.body_x.numpy()[:, chassis], np.float64)
        x, y, z, w = np.moveaxis(np.asarray(self.simulation.state.body_rot.numpy()[:, chassis], np.float64), -1, 0)
        up = np.stack([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)], axis=-1)
        return np.asarray(np.einsum("wki,wki->wk", self.wheel_places() - place, up))

    def step(self) -> None:
        """One time step, and a look at the worlds: those that break down in it get their reason."""
        self.simulation.step()
        lost = np.flatnonzero(self.broken() & (self.reason == ""))
        if len(lost):
            time = float(self.simulation.time.numpy().max())
            for world, text in zip(lost, self._fastest(lost), strict=True):
                self.reason[world] = f"a value is not finite from t = {time:.3f} s on; {text}"

    def _fastest(self, worlds: npt.NDArray[np.intp]) -> list[str]:
        """The body of the vehicle that moved fastest in each of these worlds, which are frozen as they were."""
        state, names = self.simulation.state, self.simulation.model.body_names
        v = np.linalg.norm(state.body_v.numpy()[worlds][:, self._bodies].astype(np.float64), axis=2)
        fastest = np.nan_to_num(v, nan=np.inf).argmax(axis=1)
        return [
            f"the fastest body is '{names[self._bodies[body]]}' at {speeds[body]:.3g} m/s"
            for speeds, body in zip(v, fastest, strict=True)
        ]

    def broken(self) -> npt.NDArray[np.bool_]:
        """(W,) whether a value of a world is not finite."""
        return np.asarray((self.simulation.state.world_status.numpy() & WorldStatus.NON_FINITE) != 0)
