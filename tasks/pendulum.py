"""Cart-pole: keep a pole upright by pushing its cart along a rail.

Numbers of ``chrono_pendulum-v0`` (gym-chrono, ``envs/basic/ChronoPendulum.py``), turned from Y up to Z up: the cart
slides along X, the pole turns about Y. A 0.1 kg cart carries a pole of 0.785 kg whose centre is 1 m above the hinge.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import torch

import simwarp as sw
from simwarp.tasks import (
    Drawing,
    Line,
    Mirror,
    NotNegative,
    Positive,
    Reflection,
    RewardWeights,
    Task,
    TaskConfig,
    register,
    require,
)

POLE_LENGTH = 2.0
# A cylinder of radius 0.05 m and density 50 kg/m3, along z
POLE_MASS = 0.785398
POLE_INERTIA = (0.262290, 0.262290, 0.000981748)


@dataclasses.dataclass(frozen=True)
class CartPoleRewards(RewardWeights):
    """Weights of the reward."""

    alive: float = 1.0
    """Every step, the last one included."""


@dataclasses.dataclass(frozen=True)
class CartPoleConfig(TaskConfig):
    """Configuration of the cart-pole."""

    rewards: CartPoleRewards = CartPoleRewards()
    """Weights of the reward."""
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
class PendulumTask(Task[CartPoleConfig]):
    """Observation ``policy`` (W, 4): cart position [m] and velocity, pole angle [rad] and rate; reward 1 a step.

    Attributes:
        slide, hinge: degrees of freedom of the cart and of the pole.
        late_speed: (W,) angular speed of the pole at the step before, unsigned [rad/s].
        spread: (4,) half-widths of the start: position [m], angle [rad], velocity [m/s], rate [rad/s].
    """

    summary: ClassVar[str] = "cart-pole: keep a 2 m pole upright on a light cart, 4 observations, 1 force"
    instruction: ClassVar[str] = "Keep the pole upright."
    config_type: ClassVar[type[TaskConfig]] = CartPoleConfig
    action_size: int = 1
    state_buffers: ClassVar[Mapping[str, str]] = {"late_speed": "late_speed"}
    # The cart takes seconds to drift off the rail: a horizon of 1 / (1 - gamma) = 500 steps sees that coming. With a
    # larger desired_kl a solved policy was lost again in some seeds
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 60,
        "num_envs": 256,
        "steps_per_iteration": 32,
        "ppo.epochs": 3,
        "ppo.gamma": 0.998,
        "ppo.lam": 0.97,
        "ppo.desired_kl": 0.005,
    }

    def mirror(self) -> Mirror | None:
        """Return the mirror image: everything is to the other side; unsigned observations have none."""
        if self.config.legacy_compat:
            return None
        return Mirror({"policy": Reflection((0, 1, 2, 3), (-1.0,) * 4)}, Reflection((0,), (-1.0,)))

    # ---- the six methods of a task -----------------------------------------------------------------------------

    def build(self, builder: sw.ModelBuilder) -> None:
        """A cart on a rail along X and a pole hinged to it about Y."""
        cart = builder.add_body("cart", mass=0.1, inertia=(1.0, 1.0, 1.0))
        middle = sw.pose((0, 0, 0.5 * POLE_LENGTH))
        pole = builder.add_body("pole", mass=POLE_MASS, inertia=POLE_INERTIA, pose=middle)
        builder.add_joint_prismatic("slide", sw.WORLD, cart, axis=(1, 0, 0))
        builder.add_joint_revolute("hinge", cart, pole, anchor=(0, 0, 0), axis=(0, 1, 0))

    def apply(self, action: torch.Tensor) -> None:
        """Push the cart with ``force_gain`` newtons per unit of action."""
        self.views.joint_force[:, self.slide] = action[:, 0] * self.config.force_gain

    def observations(self) -> dict[str, torch.Tensor]:
        """Return ``policy``: (W, 4) float32."""
        state = torch.stack([self.views.joint_q, self.views.joint_qd], dim=2).flatten(1)
        return {"policy": self.as_original() if self.config.legacy_compat else state}

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return ``alive``, in every step, the last one included."""
        return {"alive": torch.full((self.num_worlds,), self.config.rewards.alive, device=self.device)}

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``fell`` and ``off_track``."""
        x, angle = self.views.joint_q[:, self.slide], self.views.joint_q[:, self.hinge]
        return {"fell": angle.abs() > self.config.max_angle, "off_track": x.abs() > self.config.max_position}

    def reset(self, world_mask: torch.Tensor) -> None:
        """Start near upright, somewhere around the middle of the rail."""
        self.late_speed.masked_fill_(world_mask, 0.0)
        start = self.random.uniform("start", -1.0, 1.0, size=4) * self.spread
        self.simulation.set_joint_state(world_mask, start[:, :2].contiguous(), start[:, 2:].contiguous())

    # ---- the observations of the original, and pictures ----------------------------------------------------------

    def setup(self) -> None:
        """Find the degrees of freedom; allocate the start state and the late angular speed of the original."""
        self.slide, self.hinge = self.simulation.model.dof("slide"), self.simulation.model.dof("hinge")
        self.late_speed = torch.zeros(self.num_worlds, device=self.device)
        config = self.config
        moving = 0.0 if config.legacy_compat else 1.0
        spread = [config.start_position, config.start_angle, config.start_rate, config.start_rate]
        self.spread = moving * torch.tensor(spread, device=self.device)

    def begin_step(self) -> None:
        """Keep the angular speed that the original shows one step late."""
        self.late_speed.copy_(self.views.joint_qd[:, self.hinge].abs())

    def as_original(self) -> torch.Tensor:
        """Return (W, 4): unsigned position and its rate, angle, unsigned angular speed one step late."""
        x, v = self.views.joint_q[:, self.slide], self.views.joint_qd[:, self.slide]
        return torch.stack([x.abs(), v * x.sign(), self.views.joint_q[:, self.hinge], self.late_speed], dim=1)

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Show the cart and the pole on a rail of light and dark half metres, counted from the middle.

        Red blocks stand behind the places where an episode ends; nothing here collides.
        """
        reach = self.config.max_position
        visuals.add_plane(name="floor", pose=sw.pose((0, 0, -0.6)))
        for number in range(math.ceil(2.0 * reach)):
            low, high = 0.5 * number, min(0.5 * (number + 1), reach)
            shade = (0.85, 0.85, 0.82) if number % 2 == 0 else (0.05, 0.055, 0.06)
            for side in (-1.0, 1.0):
                middle = sw.pose((0.5 * side * (low + high), 0, -0.16))
                visuals.add_box(sw.WORLD, half=(0.5 * (high - low), 0.06, 0.05), pose=middle, color=shade)
        for end in (-1.0, 1.0):
            block, leg = sw.pose((end * (reach + 0.2), 0, -0.04)), sw.pose((end * (reach + 0.2), 0, -0.4))
            visuals.add_box(sw.WORLD, half=(0.05, 0.11, 0.16), pose=block, color=(0.6, 0.03, 0.03))
            visuals.add_cylinder(sw.WORLD, radius=0.035, half_length=0.2, pose=leg, color=(0.3, 0.3, 0.32))
        visuals.add_box(0, half=(0.15, 0.1, 0.1), name="cart", color=(0.05, 0.22, 0.55))
        visuals.add_cylinder(1, radius=0.05, half_length=0.5 * POLE_LENGTH, name="pole", color=(0.78, 0.22, 0.05))

    def shot(self) -> sw.viewer.Shot:
        """From the side, at rest: the whole rail is in sight."""
        away = max(self.config.max_position + 0.4, 2.0)
        return sw.viewer.Shot(
            body=-1, target=(0.0, 0.0, 0.75), eye=(-0.2 * away, -2.6 * away, 0.45 * away), fov=2.0 * math.atan(0.42)
        )

    def drawing(self) -> Drawing:
        """Mark how far the cart may go."""
        reach = self.config.max_position
        ends = torch.tensor([[[x, 0.0, -0.3], [x, 0.0, 0.3]] for x in (-reach, reach)], device=self.device)
        return Drawing(tuple(Line(end.expand(self.num_worlds, 2, 3), "tab:red", 2.0) for end in ends))
