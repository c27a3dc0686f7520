"""Cart-pole: keep a pole upright by pushing its cart along a rail. The shortest task: six methods.

Configuration, pictures and the observations of the original are in `cart_pole_base.py`.
"""

from __future__ import annotations

import torch

import simwarp as sw
from simwarp.tasks import register

from .cart_pole_base import POLE_INERTIA, POLE_LENGTH, POLE_MASS, CartPole


@register("pendulum")
class PendulumTask(CartPole):
    """Observation ``policy`` (W, 4): cart position [m] and velocity, pole angle [rad] and rate; reward 1 a step."""

    action_size: int = 1

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
