"""Force sensors: what a body feels in contact, and what a joint transmits."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar

import warp as wp

from simwarp.core.constraints import Meaning, NotNegative
from simwarp.core.types import WORLD, ModelError, Quat, formatted, pose
from simwarp.model.model import Model
from simwarp.sensors.clock import Field, mount_arrays
from simwarp.sensors.frame_sensor import VectorSensor
from simwarp.sensors.interface import Configuration, Mount, Schedule, body_index, checked_config, sensor_index
from simwarp.sensors.motion.force_sensor_kernels import sample_forces, sample_touch
from simwarp.sensors.noise import Noise, NoiseChain
from simwarp.simulation.attachments import StepContext


@dataclasses.dataclass(frozen=True, kw_only=True)
class ContactSensorConfig(Configuration):
    """A sensor of contact forces.

    Attributes:
        schedule: times of the measurements; frames are means over the window.
        threshold: of the measured force from which on `touch` is true [N]; 0: any force.
        noise: of the force [N], per axis or for all.
    """

    schedule: Schedule = dataclasses.field(default_factory=lambda: Schedule(rate=1000.0))
    threshold: Annotated[NotNegative, Meaning("newtons, 0 for any force")] = 0.0
    noise: tuple[Noise, ...] = ()


@dataclasses.dataclass(frozen=True, kw_only=True)
class LoadCellConfig(Configuration):
    """A sensor of what a joint transmits.

    Attributes:
        schedule: times of the measurements; frames are means over the window.
        noise: of the force [N], per axis or for all.
        torque_noise: of the torque [N·m], per axis or for all.
    """

    schedule: Schedule = dataclasses.field(default_factory=lambda: Schedule(rate=1000.0))
    noise: tuple[Noise, ...] = ()
    torque_noise: tuple[Noise, ...] = ()


class ContactSensor(VectorSensor):
    """The sum of all contact forces on a body, in axes of the sensor. Tires are force elements: they are not in it.

    Forces of a sub-step are given in the axes that the sensor had at its beginning.

    Args:
        model: whose worlds it measures; with shapes.
        mount: the body, and the axes of the sensor on it; its place does not matter.
        config: schedule, threshold and noise.
        name: unique in a Simulation.
        seed: of the noise, together with the name.
        randomised: True if every world has rows of its own in noise parameters and mount.

    Attributes:
        data: (W, 3) float32 [N]; zero until the first step after a state was set.
        truth: the same without noise.
        touch: (W,) uint8, 1 where the measured force reaches the threshold.
        noise: numbers of the noise (`NoiseChain.parameter`).

    Raises:
        ModelError: the body does not exist, or nothing can touch it.
    """

    only_in_windows: ClassVar[bool] = True
    noise: NoiseChain

    def __init__(
        self, model: Model, mount: Mount, config: ContactSensorConfig | None = None, *, name: str = "contact",
        seed: int = 0, randomised: bool = False,
    ) -> None:  # fmt: skip
        self.config = checked_config(name, config, ContactSensorConfig)
        super().__init__(
            model, name, self.config.schedule, 3, {"noise": (self.config.noise, 3)}, mount=mount, seed=seed,
            randomised=randomised, others={"touch": Field((), wp.uint8)},
        )  # fmt: skip
        self._body = body_index(name, mount.body, model)
        if self._body == WORLD or not (model.topology.shape_body.numpy() == self._body).any():
            raise ModelError(
                f"sensor '{name}': body must have a shape, got {formatted(mount.body)}; add one with add_shape_..."
            )

    @property
    def touch(self) -> wp.array:
        """(W,) uint8, 1 where the measured force reaches the threshold."""
        return self.frames.data["touch"]

    def _sample(self, simulation: StepContext) -> Sequence[Any]:
        model, frames = simulation.model, self.frames
        forces = simulation.contacts.body_contact_force
        no_torques = wp.zeros((model.world_count, 0), dtype=wp.vec3, device=model.device)
        touch = simulation.shares.record(
            sample_touch,
            inputs=[self.config.threshold, frames.tick, frames.ring["data"]], outputs=[frames.ring["touch"]],
        )  # fmt: skip
        return [_record_forces(self, self.mount, forces, no_torques, self._body, simulation), touch]


class LoadCell(VectorSensor):
    """Force and torque that a joint applies to its second body, at anchor 1, drives and limits included.

    Needs `Simulation(..., joint_reactions=True)`.

    Args:
        model: whose worlds it measures.
        joint: by name or index.
        config: schedule and noise.
        name: unique in a Simulation.
        rotation: xyzw, of the sensor's axes on the joint's second body.
        seed: of the noise, together with the name.
        randomised: True if every world has rows of its own in noise parameters and mount.

    Attributes:
        data: (W, 6) float32: force [N], then torque about anchor 1 [N·m], in axes of the sensor; zero until the first
            step after a state was set.
        truth: the same without noise.
        noise, torque_noise: numbers of the noise (`NoiseChain.parameter`).

    Raises:
        ModelError: the joint does not exist, or the Simulation records no reactions.
    """

    only_in_windows: ClassVar[bool] = True
    noise: NoiseChain
    torque_noise: NoiseChain

    def __init__(
        self, model: Model, joint: str | int, config: LoadCellConfig | None = None, *, name: str = "load_cell",
        rotation: Quat = (0.0, 0.0, 0.0, 1.0), seed: int = 0, randomised: bool = False,
    ) -> None:  # fmt: skip
        self.config = checked_config(name, config, LoadCellConfig)
        noise = {"noise": (self.config.noise, 3), "torque_noise": (self.config.torque_noise, 3)}
        super().__init__(model, name, self.config.schedule, 6, noise, seed=seed, randomised=randomised)
        self._joint = _joint_index(name, joint, model)
        body = int(model.topology.joint_body1.numpy()[self._joint])
        self.mount = mount_arrays(name, Mount(body, pose(rotation=rotation)), model, self.copies)

    def check(self, simulation: StepContext, dt: float) -> None:
        """Refuses a Simulation that it cannot be part of.

        Raises:
            ModelError: see `FrameBuffer.check`; or the Simulation records no joint reactions.
        """
        super().check(simulation, dt)
        if simulation.diagnostics.joint_reaction_force.shape[0] == 0:
            raise ModelError(
                f"sensor '{self.name}': reactions must be recorded, got joint_reactions=False; "
                "write Simulation(..., joint_reactions=True)"
            )

    def _sample(self, simulation: StepContext) -> Sequence[Any]:
        reports = simulation.diagnostics
        return [
            _record_forces(
                self, self.mount, reports.joint_reaction_force, reports.joint_reaction_torque, self._joint, simulation
            )
        ]


def _record_forces(
    sensor: ContactSensor | LoadCell, mount: Any, force: wp.array, torque: wp.array, index: int, simulation: StepContext
) -> Any:
    frames = sensor.frames
    torque_noise = sensor.torque_noise if isinstance(sensor, LoadCell) else sensor.noise
    return simulation.shares.record(
        sample_forces,
        inputs=[
            frames.dt, frames.clock, mount, force, torque, index, simulation.state.arrays, frames.tick,
            sensor.noise.arrays, torque_noise.arrays, sensor._sums,
        ],
        outputs=[frames.ring["truth"], frames.ring["data"]],
    )  # fmt: skip


def _joint_index(sensor: str, joint: str | int, model: Model) -> int:
    rule = f"joint must be a name or an index below {model.joint_count}"
    remedy = "take what add_joint_... returned"
    return sensor_index(sensor, rule, joint, model.joint_count, model.joint, remedy)
