"""Cart-pole: keep a pole upright on a cart by pushing the cart along a rail.

Numbers of ``chrono_pendulum-v0`` (gym-chrono, ``envs/basic/ChronoPendulum.py``), turned from Y up to Z up: the cart
slides along X, the pole turns about Y. A 0.1 kg cart carries a pole of 0.785 kg whose centre is 1 m above the hinge.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import torch

from simwarp.tasks import NotNegative, Positive, renamed_fields

from .framework.config import TaskConfig, require
from .framework.drawing import Drawing, Line
from .framework.registry import register
from .framework.task import Task

if TYPE_CHECKING:
    from simwarp import ModelBuilder
    from simwarp.sensors import Visuals
    from simwarp.viewer import Shot

_CART_MASS = 0.1
_CART_HALF_SIZE = 0.15
_POLE_LENGTH = 2.0
# A cylinder of radius 0.05 m and density 50 kg/m3, along z
_POLE_MASS = 0.785398
_POLE_INERTIA = (0.262290, 0.262290, 0.000981748)
_SLIDE, _HINGE = 0, 1


@renamed_fields(quirks="legacy_compat")
@dataclasses.dataclass(frozen=True)
class PendulumConfig(TaskConfig):
    """Configuration of :class:`PendulumTask`."""

    gravity: float = 9.81
    """Gravitational acceleration, downwards [m/s2]."""
    force_gain: Positive = 1.0
    """Force on the cart of a full action [N]."""
    max_position: Positive = 2.0
    """Distance of the cart from the middle at which an episode fails [m]."""
    max_angle: Positive = 0.2
    """Angle of the pole at which an episode fails [rad]."""
    start_position: float = 0.5
    """Half-width of the uniform start position of the cart [m]."""
    start_angle: float = 0.05
    """Half-width of the uniform start angle of the pole [rad]."""
    start_rate: NotNegative = 0.02
    """Half-width of the uniform start velocity [m/s] and angular velocity [rad/s]."""
    legacy_compat: bool = False
    """Observe as the original did: unsigned position and its rate, unsigned angular speed one step late; and start
    exactly upright at rest."""

    def validate(self) -> None:
        """Check ranges: a start must lie inside the limits."""
        require(0.0 <= self.start_position < self.max_position, self, "start_position", "in [0, max-position)")
        require(0.0 <= self.start_angle < self.max_angle, self, "start_angle", "in [0, max-angle)")


@register("pendulum")
class PendulumTask(Task[PendulumConfig]):
    """Observation ``policy`` (W, 4): cart position [m] and velocity, pole angle [rad] and rate; reward 1 per step."""

    summary: ClassVar[str] = "cart-pole: keep a 2 m pole upright on a light cart, 4 observations, 1 force"
    config_type: ClassVar[type[TaskConfig]] = PendulumConfig
    action_size: int = 1
    # The cart takes seconds to drift off the rail: a horizon of 1 / (1 - gamma) = 500 steps sees that coming. With a
    # larger desired_kl a solved policy was lost again in some seeds
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 150,
        "num_envs": 256,
        "steps_per_iteration": 32,
        "ppo.gamma": 0.998,
        "ppo.lam": 0.97,
        "ppo.desired_kl": 0.005,
    }

    def build(self, builder: ModelBuilder) -> None:
        """A cart on a rail along X and a pole hinged to it about Y."""
        import simwarp as sw

        cart = builder.add_body("cart", mass=_CART_MASS, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0, 0, 0)))
        pole = builder.add_body(
            "pole", mass=_POLE_MASS, inertia=_POLE_INERTIA, pose=sw.pose((0, 0, 0.5 * _POLE_LENGTH))
        )
        builder.add_joint_prismatic("slide", sw.WORLD, cart, axis=(1, 0, 0))
        builder.add_joint_revolute("hinge", cart, pole, anchor=(0, 0, 0), axis=(0, 1, 0))

    def setup(self) -> None:
        """Allocate the start state and the late angular speed of the original's observation."""
        self.q, self.qd = self.views.joint_q, self.views.joint_qd
        self._late_speed = torch.zeros(self.num_worlds, device=self.device)
        config = self.config
        moving = 0.0 if config.legacy_compat else 1.0
        spread = [config.start_position, config.start_angle, config.start_rate, config.start_rate]
        self._spread = moving * torch.tensor(spread, device=self.device)

    def begin_step(self) -> None:
        """Keep the angular speed that the original shows one step late."""
        self._late_speed.copy_(self.qd[:, _HINGE].abs())

    def apply(self, action: torch.Tensor) -> None:
        """Push the cart with ``force_gain`` newtons per unit of action."""
        self.views.joint_force[:, _SLIDE] = action[:, 0] * self.config.force_gain

    def observations(self) -> dict[str, torch.Tensor]:
        """Return ``policy``: (W, 4) float32."""
        if self.config.legacy_compat:
            x, v = self.q[:, _SLIDE], self.qd[:, _SLIDE]
            return {"policy": torch.stack([x.abs(), v * x.sign(), self.q[:, _HINGE], self._late_speed], dim=1)}
        return {"policy": torch.stack([self.q, self.qd], dim=2).flatten(1)}

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return ``alive``: 1 in every step, the last one included."""
        return {"alive": torch.ones(self.num_worlds, device=self.device)}

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``fell`` and ``off_track``."""
        return {
            "fell": self.q[:, _HINGE].abs() > self.config.max_angle,
            "off_track": self.q[:, _SLIDE].abs() > self.config.max_position,
        }

    def reset(self, world_mask: torch.Tensor) -> None:
        """Start near upright, somewhere around the middle of the rail."""
        start = self.random.uniform("start", -1.0, 1.0, size=4) * self._spread
        self._late_speed.masked_fill_(world_mask, 0.0)
        self.simulation.set_joint_state(world_mask, start[:, :2].contiguous(), start[:, 2:].contiguous())

    def visuals(self, visuals: Visuals) -> None:
        """Show the rail, the cart and the pole: nothing here collides."""
        import simwarp as sw

        along_x = sw.pose(rotation=(0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)))
        visuals.add_plane(name="floor", pose=sw.pose((0, 0, -0.6)))
        visuals.add_cylinder(sw.WORLD, radius=0.03, half_length=3.0, name="rail", pose=along_x, color=(0.3, 0.3, 0.32))
        visuals.add_box(0, half=(_CART_HALF_SIZE, 0.1, 0.1), name="cart", color=(0.05, 0.22, 0.55))
        visuals.add_cylinder(1, radius=0.05, half_length=0.5 * _POLE_LENGTH, name="pole", color=(0.78, 0.22, 0.05))

    def shot(self) -> Shot:
        """From the side, at rest: the whole rail is in sight."""
        from simwarp.viewer import Shot

        return Shot(body=-1, target=(0.0, 0.0, 0.75), eye=(-1.5, -8.5, 1.2), fov=0.6)

    def drawing(self) -> Drawing:
        """Mark how far the cart may go."""
        reach = self.config.max_position
        ends = torch.tensor([[[x, 0.0, -0.3], [x, 0.0, 0.3]] for x in (-reach, reach)], device=self.device)
        return Drawing(tuple(Line(end.expand(self.num_worlds, 2, 3), "tab:red", 2.0) for end in ends))

    def extra_state(self) -> dict[str, torch.Tensor]:
        """The late angular speed; the simulation keeps the rest."""
        return {"late_speed": self._late_speed}

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Take the late angular speed back."""
        self._late_speed.copy_(state["late_speed"])
