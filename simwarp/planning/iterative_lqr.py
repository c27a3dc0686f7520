"""Iterative linear-quadratic regulator (Li and Todorov 2004; Tassa, Erez and Todorov 2012).

The step is linearised along the plan and the cost expanded to second order; Riccati's recursion improves the plan, and
lengths of the way there are tried.

Linearisation is by central differences of the simulation's own control step, all steps and directions side by side in
the imagined worlds: it holds for whatever a step contains, drives, springs and tires, and has no step size in time.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, TypeAlias

import torch

from simwarp.core.constraints import Count, Positive
from simwarp.core.interop import to_torch
from simwarp.core.object_repr import Readable
from simwarp.core.types import JointType, ModelError
from simwarp.model.rules import Configuration
from simwarp.planning.imagination import Imagination
from simwarp.simulation.simulation import Simulation

StateCost: TypeAlias = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]
"""Cost of one state (2d,) of coordinates and rates and one action (A,), both float64: a number, by torch operations."""
EndStateCost: TypeAlias = Callable[[torch.Tensor], torch.Tensor]

TURNING = (JointType.SPHERICAL, JointType.FREE)
"""Joints whose coordinates are no vector: sums of them are no states."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class IlqrConfig(Configuration):
    """Configuration of `Ilqr`.

    Attributes:
        horizon: control steps that a plan looks ahead.
        iterations: most of them for one plan.
        tolerance: share of the cost below which an improvement ends the iterations.
        position_step: change of a coordinate for a difference [m or rad].
        rate_step: change of a rate [m/s or rad/s].
        action_step: change of an action, as a share of its range.
        damping: added to the cost's curvature in the actions once no way ahead was better; ten times more each time.
    """

    horizon: Count = 50
    iterations: Count = 10
    tolerance: Positive = 1e-6
    position_step: Positive = 1e-3
    rate_step: Positive = 1e-2
    action_step: Positive = 1e-2
    damping: Positive = 1e-2


class Ilqr(Readable):
    """Plans for one real world whose state is the coordinates of its joints and their rates.

    Args:
        imagination: of Simulations, for one real world: its worlds take differences and try ways ahead.
        cost: of a control step: takes the state before it (2d,) and the action (A,), float64, and returns a number;
            torch differentiates it twice.
        config: its numbers.
        end_cost: of the state at the end of the horizon; None: none.

    Attributes:
        actions: (horizon, A) float64, the plan.
        gains: (horizon, A, 2d) feedback on the state along the plan: u = actions + gains (x - states).
        states: (horizon + 1, 2d) of the plan.
        cost: of the plan.

    Raises:
        ModelError: a body moves without a joint, or turns freely, or plans are for several worlds.
    """

    def __init__(
        self, imagination: Imagination, cost: StateCost, config: IlqrConfig | None = None, *,
        end_cost: EndStateCost | None = None,
    ) -> None:  # fmt: skip
        sim, self.config = imagination.simulation, config or IlqrConfig()
        _check(imagination)
        self.imagination, self._simulation = imagination, sim
        self._stage = torch.func.vmap(cost)
        self._end = torch.func.vmap(end_cost or (lambda x: 0.0 * x.sum()))
        self._first = torch.func.vmap(torch.func.jacrev(cost, argnums=(0, 1)))
        self._second = torch.func.vmap(torch.func.hessian(cost, argnums=(0, 1)))
        self._end_first = torch.func.jacrev(end_cost or (lambda x: 0.0 * x.sum()))
        self._end_second = torch.func.hessian(end_cost or (lambda x: 0.0 * x.sum()))
        self._q, self._qd = to_torch(sim.state.joint_x), to_torch(sim.state.joint_qd)
        self.low, self.high = imagination.low.double(), imagination.high.double()
        self.reset()

    def _readable_title(self) -> str:
        return f": {self.config.horizon} control steps ahead, {self.imagination.count} imagined worlds"

    def reset(self, actions: torch.Tensor | None = None) -> None:
        """Forgets the plan; `actions` (horizon, A) or less to begin with, the middle of the bounds by default."""
        config, size, states = self.config, self.imagination.action_size, 2 * self._simulation.model.dof_count
        options: Any = {"dtype": torch.float64, "device": self.imagination.device}
        self.actions = torch.zeros(config.horizon, size, **options)
        self.actions.copy_(0.5 * (self.low + self.high) if actions is None else actions)
        self.gains = torch.zeros(config.horizon, size, states, **options)
        self.states = torch.zeros(config.horizon + 1, states, **options)
        self.cost, self._fresh, self._damping = float("inf"), True, 0.0

    def plan(self) -> torch.Tensor:
        """Plans from the present state of the real world, beginning with the last plan one control step on.

        Returns:
            (1, A) float32: what to do in this control step.
        """
        if not self._fresh:
            self.actions = torch.cat([self.actions[1:], self.actions[-1:]])
        self._fresh = False
        none = torch.zeros_like(self.actions)
        self._accept(*self._tried(none, torch.zeros_like(self.gains), torch.zeros(1, dtype=torch.float64)))
        for _ in range(self.config.iterations):
            feed, gains = self._improvement(*self._differences(), self._damping)
            lengths = 0.5 ** torch.arange(min(self.imagination.count, 11), dtype=torch.float64)
            states, actions, costs = self._tried(feed, gains, lengths)
            best = int(torch.argmin(costs))
            if not float(costs[best]) < self.cost:
                self._damping = max(10.0 * self._damping, self.config.damping)
                continue
            gained = self.cost - float(costs[best])
            self._accept(states, actions, costs, best)
            self.gains, self._damping = gains, 0.1 * self._damping if self._damping > self.config.damping else 0.0
            if gained < self.config.tolerance * abs(self.cost):
                break
        return self.actions[:1].float()

    def _accept(self, states: torch.Tensor, actions: torch.Tensor, costs: torch.Tensor, world: int = 0) -> None:
        self.states, self.actions, self.cost = states[world].clone(), actions[world].clone(), float(costs[world])

    def _tried(
        self, feed: torch.Tensor, gains: torch.Tensor, lengths: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """States (n, horizon + 1, 2d), actions and costs of n ways ahead, each with so much of the improvement."""
        imagination, count = self.imagination, len(lengths)
        imagination.begin()
        ways = torch.zeros(imagination.count, 1, dtype=torch.float64, device=imagination.device)
        ways[:count, 0] = lengths.to(imagination.device)
        states, actions = [self._state()], []
        for step in range(self.config.horizon):
            change = ways * feed[step] + (states[-1] - self.states[step]) @ gains[step].T
            action = torch.clamp(self.actions[step] + change, self.low, self.high)
            imagination.advance(action.float())
            states.append(self._state())
            actions.append(action)
        x, u = torch.stack(states, dim=1)[:count], torch.stack(actions, dim=1)[:count]
        cost = self._stage(x[:, :-1].flatten(0, 1), u.flatten(0, 1)).view(count, -1).sum(dim=1) + self._end(x[:, -1])
        return x, u, torch.where(torch.isfinite(cost), cost, torch.inf)

    def _state(self) -> torch.Tensor:
        return torch.cat([self._q, self._qd.double()], dim=1)

    def _differences(self) -> tuple[torch.Tensor, torch.Tensor]:
        """A (horizon, 2d, 2d) and B (horizon, 2d, A) of the control steps along the plan."""
        config, dofs, size = self.config, self._simulation.model.dof_count, self.imagination.action_size
        steps = torch.cat([
            torch.full((dofs,), config.position_step), torch.full((dofs,), config.rate_step),
            config.action_step * (self.high - self.low).cpu(),
        ]).to(self.states)  # fmt: skip
        changes = torch.cat([torch.diag(steps), -torch.diag(steps)])
        along = torch.cat([self.states[:-1], self.actions], dim=1)
        points = (along[:, None] + changes).flatten(0, 1).float()  # as the simulation takes them
        reached = torch.cat([self._stepped(part) for part in points.split(self.imagination.count)])
        up, down = reached.view(len(along), 2, len(steps), -1).unbind(dim=1)
        ends = points.double().view(len(along), 2, len(steps), -1)
        width = torch.diagonal(ends[:, 0] - ends[:, 1], dim1=1, dim2=2)
        slopes = ((up - down) / width[..., None]).transpose(1, 2)
        return slopes[..., :-size], slopes[..., -size:]

    def _stepped(self, points: torch.Tensor) -> torch.Tensor:
        """(n, 2d) states one control step after states and actions (n, 2d + A), n worlds at most."""
        dofs, count = self._simulation.model.dof_count, len(points)
        filled = torch.cat([points, points[:1].expand(self.imagination.count - count, -1)])
        self.imagination.begin()  # what joints do not tell, such as memory of elements, is that of now
        q, qd = filled[:, :dofs].contiguous(), filled[:, dofs : 2 * dofs].contiguous()
        self._simulation.set_joint_state(None, q, qd)
        self.imagination.advance(filled[:, 2 * dofs :].contiguous())
        return self._state()[:count]

    def _improvement(self, a: torch.Tensor, b: torch.Tensor, damping: float) -> tuple[torch.Tensor, torch.Tensor]:
        """Changes of the actions (horizon, A) and gains (horizon, A, 2d) by Riccati's recursion."""
        x, u = self.states[:-1], self.actions
        (lx, lu), ((lxx, _), (lux, luu)) = self._first(x, u), self._second(x, u)
        vx, vxx = self._end_first(self.states[-1]), self._end_second(self.states[-1])
        feed, gains = torch.zeros_like(self.actions), torch.zeros_like(self.gains)
        identity = torch.eye(u.shape[1], dtype=u.dtype, device=u.device)
        for t in reversed(range(len(u))):
            qx, qu = lx[t] + a[t].T @ vx, lu[t] + b[t].T @ vx
            qxx, qux = lxx[t] + a[t].T @ vxx @ a[t], lux[t] + b[t].T @ vxx @ a[t]
            quu = luu[t] + b[t].T @ vxx @ b[t]
            # directions in which the cost bends down are taken as bending up: the change stays one that improves
            values, axes = torch.linalg.eigh(0.5 * (quu + quu.T) + damping * identity)
            inverse = axes @ torch.diag(1.0 / values.abs().clamp(min=1e-12)) @ axes.T
            feed[t], gains[t] = -inverse @ qu, -inverse @ qux
            vx = qx + gains[t].T @ quu @ feed[t] + gains[t].T @ qu + qux.T @ feed[t]
            vxx = qxx + gains[t].T @ quu @ gains[t] + gains[t].T @ qux + qux.T @ gains[t]
            vxx = 0.5 * (vxx + vxx.T)
        return feed, gains


def _check(imagination: Imagination) -> None:
    """Raises a ModelError where a state is no vector of coordinates and rates."""
    if not isinstance(imagination.real, Simulation):
        raise ModelError("Ilqr: the imagination must be of Simulations, got tasks; sample plans for these")
    if imagination.plans != 1:
        raise ModelError(f"Ilqr: plans are for one real world, got {imagination.plans}; give Imagination(worlds=[0])")
    model = imagination.simulation.model
    if model.topology.row_count:
        raise ModelError("Ilqr: joints must form trees, got loops or couplings; sample plans for such a model")
    turning = [name for name, kind in zip(model.joint_names, model.joint_types, strict=True) if kind in TURNING]
    links = model.topology.link_joint.numpy()
    if turning or (links < 0).any():
        what = f"joint '{turning[0]}'" if turning else "a body without a joint"
        raise ModelError(
            f"Ilqr: every body must move by joints whose coordinates add up, got {what}; sample plans for it"
        )
