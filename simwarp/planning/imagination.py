"""Imagined worlds: copies of real ones in which plans are tried. The real ones never change."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeAlias, runtime_checkable

import torch
import warp as wp

from simwarp.core.interop import to_torch
from simwarp.core.object_repr import Readable, plural
from simwarp.core.types import ModelError, WorldStatus, formatted
from simwarp.model.checks import whole_number
from simwarp.simulation.simulation import Simulation


@runtime_checkable
class ActingWorlds(Protocol):
    """Worlds that have actions, as a task's: what plans need of them.

    Attributes:
        num_worlds: how many there are.
        agents, action_size: agents of a world, and numbers of the action of each.
        device: of tensors.
        simulation: their physics.
    """

    num_worlds: int
    agents: int
    action_size: int
    device: Any
    simulation: Any

    def look_ahead(self, action: torch.Tensor) -> None:
        """Takes the physics through one control step by actions (W, agents · action_size) from -1 to 1."""

    def copy_worlds(self, source: Any, targets: Any = None, *, of: Any = None) -> None:
        """Makes worlds copies of those of another one, as `Simulation.copy_worlds`."""


Worlds: TypeAlias = ActingWorlds | Simulation
Cost: TypeAlias = Callable[[Any, torch.Tensor], torch.Tensor]
"""Takes the imagined task or simulation and the action (N, A); returns (N,) the cost of the control step just made."""
EndCost: TypeAlias = Callable[[Any], torch.Tensor]
"""Takes the imagined task or simulation at the end of the horizon; returns (N,)."""


class Imagination(Readable):
    """N imagined worlds that become copies of a real one, or N / R of each of R real ones.

    Real and imagined worlds are two tasks of one configuration and seed, or two Simulations of one ModelBuilder. They
    may differ in the number of worlds and, on purpose, in parameters: a plan may be made with a model that is wrong.

    Args:
        real: whose worlds are copied; it is only read.
        imagined: with N worlds.
        act: of Simulations: writes (N, A) actions into the controls of `imagined`; a task has its `apply`.
        action_size: of Simulations: A, numbers of an action.
        low, high: bounds of actions, of all or of each; tasks take -1 to 1.
        steps: of Simulations: steps of one control step.
        worlds: of the real ones for which plans are made; None: all.
        parameters: copy parameters that differ by world; False: imagined worlds keep their own.

    Attributes:
        plans: R, real worlds that are planned for.
        samples: N / R, imagined worlds of each.
        low, high: (A,) float32 bounds.
        device: of tensors.

    Raises:
        ModelError: the two are no such pair, N is no multiple of R, or actions are not described.
    """

    def __init__(
        self, real: Worlds, imagined: Worlds, *, act: Callable[[torch.Tensor], object] | None = None,
        action_size: int | None = None, low: float | Sequence[float] = -1.0, high: float | Sequence[float] = 1.0,
        steps: int = 1, worlds: Sequence[int] | None = None, parameters: bool = True,
    ) -> None:  # fmt: skip
        thing = "Imagination"
        if real is imagined:
            raise ModelError(f"{thing}: imagined must be worlds of its own, got those of real; make a second one")
        self.real, self.imagined = real, imagined
        self._parameters = parameters
        if isinstance(real, ActingWorlds) and isinstance(imagined, ActingWorlds):
            if act is not None or action_size is not None:
                raise ModelError(
                    f"{thing}: act and action_size must be left out for tasks, which have their own, got some"
                )
            self.action_size = imagined.action_size * imagined.agents
            count, self.device = imagined.num_worlds, imagined.device
            self.simulation: Simulation = imagined.simulation
            self._act: Callable[[torch.Tensor], object] = imagined.look_ahead
            self._steps, of_real = 0, real.num_worlds
        elif isinstance(real, Simulation) and isinstance(imagined, Simulation):
            if not callable(act) or action_size is None:
                raise ModelError(f"{thing}: Simulations need act=function and action_size=A, got {formatted(act)}")
            self.action_size = whole_number(thing, "action_size", action_size, 1, 2**20, "count the inputs")
            count, of_real = imagined.model.world_count, real.model.world_count
            self.device = torch.device(wp.device_to_torch(imagined.model.device))
            self.simulation, self._act = imagined, act
            self._steps = whole_number(thing, "steps", steps, 1, 2**20, "1 is the default")
        else:
            kinds = f"{type(real).__name__} and {type(imagined).__name__}"
            raise ModelError(f"{thing}: real and imagined must be two tasks or two Simulations, got {kinds}")
        self.worlds = list(range(of_real)) if worlds is None else [
            whole_number(thing, "each of worlds", world, 0, of_real - 1, "count from 0") for world in worlds
        ]  # fmt: skip
        self.plans = len(self.worlds)
        if not self.plans or count % self.plans:
            raise ModelError(
                f"{thing}: imagined must have as many worlds for each of {self.plans} real ones, got {count}; "
                f"take {max(self.plans, 1) * math.ceil(count / max(self.plans, 1))}"
            )
        self._status = to_torch(self.simulation.state.world_status)
        self.samples, self.count = count // self.plans, count
        self.low, self.high = self._bounds(thing, low, high)
        one = self.plans == 1
        self._sources: Any = self.worlds[0] if one else [world for world in self.worlds for _ in range(self.samples)]

    def _readable_title(self) -> str:
        return f": {plural(self.samples, 'world')} for each of {plural(self.plans, 'real one')} on {self.device}"

    def begin(self) -> None:
        """All imagined worlds become copies of their real one."""
        if isinstance(self.imagined, Simulation):
            assert isinstance(self.real, Simulation)
            self.imagined.copy_worlds(self._sources, of=self.real, parameters=self._parameters)
        else:
            self.imagined.copy_worlds(self._sources, of=self.real)

    def advance(self, action: torch.Tensor) -> None:
        """Takes the imagined worlds through one control step; `action` is (N, A)."""
        self._act(action)
        if self._steps:
            self.simulation.step(self._steps)

    def costs(self, actions: torch.Tensor, cost: Cost, end_cost: EndCost | None) -> torch.Tensor:
        """(R, samples) float64 summed costs of (R, samples, horizon, A) actions; infinite where a world broke down."""
        self.begin()
        total = torch.zeros(self.count, dtype=torch.float64, device=self.device)
        flat = actions.reshape(self.count, *actions.shape[2:]).to(torch.float32)
        for step in range(flat.shape[1]):
            action = flat[:, step].contiguous()
            self.advance(action)
            total += self._checked("cost", cost(self.imagined, action))
        if end_cost is not None:
            total += self._checked("end_cost", end_cost(self.imagined))
        broken = (self._status & int(WorldStatus.NON_FINITE)) != 0
        total = torch.where(broken | ~torch.isfinite(total), math.inf, total)
        return total.view(self.plans, self.samples)

    def _checked(self, name: str, value: Any) -> torch.Tensor:
        if not isinstance(value, torch.Tensor) or value.shape != (self.count,):
            given = tuple(value.shape) if isinstance(value, torch.Tensor) else formatted(value)
            raise ModelError(
                f"{name} must return a tensor ({self.count},), one for each world, got {given}; sum the rest"
            )
        return value.to(torch.float64)

    def _bounds(self, thing: str, low: Any, high: Any) -> tuple[torch.Tensor, torch.Tensor]:
        ends = []
        for name, value in (("low", low), ("high", high)):
            numbers = torch.as_tensor(value, dtype=torch.float32, device=self.device).flatten()
            if len(numbers) not in (1, self.action_size):
                given = f"{len(numbers)}; give one"
                raise ModelError(
                    f"{thing}: {name} must be one number, or {self.action_size} for the action, got {given}"
                )
            ends.append(numbers.expand(self.action_size).clone())
        if not bool((ends[0] < ends[1]).all()):
            raise ModelError(f"{thing}: low must be below high, got {formatted(low)} and {formatted(high)}; swap them")
        return ends[0], ends[1]
