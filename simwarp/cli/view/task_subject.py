"""A task with a policy, for the page: what it asks of both per control step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from simwarp.simulation.simulation import Simulation
from simwarp.tasks import StepResult, Task
from simwarp.tasks.framework.agent_rows import refuse_agents
from simwarp.train.networks.policies import Policy, reset_memory
from simwarp.viewer.live.controls.joint_coordinates import joint_series
from simwarp.viewer.live.driving.browser_driving import GOAL
from simwarp.viewer.live.subject import Actions, Floats, Mask, Path, Subject

MOST_OBSERVED = 400
"""Components of a group of observations that can be plotted."""


class TaskLoop:
    """Steps of a task under a policy, as `simwarp play` takes them: the same seed gives the same worlds.

    Args:
        task: that is stepped.
        policy: that acts.
        seed: of the worlds.

    Attributes:
        policy: may be replaced between steps.
        result: of the last step; None before the first.
        returns: (W,) rewards summed over the running episodes.
        ended: (W,) bool, of the last step.
        rewards: of the last step, term -> (W,).
    """

    def __init__(self, task: Task[Any], policy: Policy, seed: int) -> None:
        refuse_agents(task, "and the viewer shows tasks of one", "film it with simwarp play --video")
        self.task, self.policy = task, policy
        task.keep_final_observations = False
        self._observations = task.restart(seed=seed)
        reset_memory(policy)
        self.actions = torch.zeros(task.num_worlds, task.action_size, device=task.device)
        self._taken = torch.zeros_like(self.actions, dtype=torch.bool)
        self._given = torch.zeros_like(self.actions)
        self.returns = torch.zeros(task.num_worlds, device=task.device)
        self.ended = torch.zeros(task.num_worlds, dtype=torch.bool, device=task.device)
        self.rewards: dict[str, torch.Tensor] = {}
        self._begun = self.ended.clone()
        self._ended_since = self.ended.clone()
        self.result: StepResult | None = None
        self.resetting: list[Callable[[Mask | None], None]] = []
        """Called before worlds of a mask begin anew."""
        self.overrides: list[Callable[[torch.Tensor], torch.Tensor]] = []
        """Called with the (W, A) actions of every step; return those to use."""

    def advance(self) -> None:
        """One control step."""
        actions = self.policy(self._observations)
        for override in self.overrides:
            actions = override(actions)
        self.actions = torch.where(self._taken, self._given, actions.clamp(-1.0, 1.0))
        self.returns *= ~self._begun
        result = self.result = self.task.step(self.actions)
        self._observations = result.observations
        self.rewards = dict(zip(self.task.reward_terms, result.reward_terms.unbind(dim=1), strict=True))
        self.returns += result.rewards
        self.ended = result.terminated | result.truncated
        self._begun = self.ended
        self._ended_since |= self.ended
        reset_memory(self.policy, self.ended)

    def observations(self) -> dict[str, torch.Tensor]:
        """Observation groups as the policy gets them next."""
        return self._observations

    def ended_since(self) -> Mask:
        """(W,) worlds whose episode ended since this was called last; waits for the steps."""
        found = np.asarray(_host(self._ended_since).copy(), bool)
        self._ended_since.zero_()
        return found

    def reset(self, mask: Mask | None) -> None:
        """New episodes, in the worlds of a mask or in all."""
        for listener in self.resetting:
            listener(mask)
        task = self.task
        chosen = torch.ones(task.num_worlds, dtype=torch.bool, device=task.device)
        if mask is not None:
            chosen = torch.as_tensor(np.asarray(mask), device=task.device)
        self._observations = task.begin_episodes(chosen)
        self.returns *= ~chosen
        reset_memory(self.policy, chosen)

    def restart(self, seed: int) -> None:
        """New episodes in all worlds, drawn by a seed."""
        for listener in self.resetting:
            listener(None)
        self._observations = self.task.restart(seed=seed)
        self.returns.zero_()
        reset_memory(self.policy)

    def use(self, policy: Policy) -> None:
        """Another policy from the next step on."""
        self.policy = policy
        reset_memory(policy)

    def override(self, world: int, component: int, value: float | None) -> None:
        """A person's value for one action of a world, or the policy's again."""
        self._taken[world, component] = value is not None
        self._given[world, component] = 0.0 if value is None else float(np.clip(value, -1.0, 1.0))


def task_subject(task: Task[Any], policy: Policy, seed: int) -> tuple[Subject, TaskLoop]:
    """A task as a subject, and the loop that moves it.

    Raises:
        InputError: it has neither bodies nor a drawing.
    """
    loop = TaskLoop(task, policy, seed)
    scene = task.scene()
    simulation, shot = task.simulation, task.shot()
    advance: Callable[[], None] = loop.advance
    reset: Callable[[Mask | None], None] = loop.reset
    if scene is None:
        from simwarp.tasks.framework.task_rendering import stage  # few tasks have no bodies, and it imports matplotlib

        simulation, scene, shot = stage(task)
        advance, reset = _with_clock(loop, simulation)
    size = task.action_size
    names = tuple(getattr(task, "action_names", None) or (f"action {index}" for index in range(size)))
    actions = Actions(names, -np.ones(size), np.ones(size), lambda: _host(loop.actions), loop.override)
    subject = Subject(
        task.name, simulation, scene, float(task.config.control_dt), advance, reset, shot,
        paths=lambda: lines_of(task), trail=lambda: _trail(task), actions=actions, returns=lambda: _host(loop.returns),
        ended=loop.ended_since, elements=_elements(task), series=_series(task, loop),
        details={GOAL: lambda world: _metrics(task, world), "commands": task.commands},
    )  # fmt: skip
    return subject, loop


def _with_clock(loop: TaskLoop, clock: Simulation) -> tuple[Callable[[], None], Callable[[Mask | None], None]]:
    """Steps and resets of a task without bodies, told to a simulation that has its time."""

    def advance() -> None:
        clock.reset(_host(loop.ended))  # their episodes begin with this step
        loop.advance()
        clock.step()

    def reset(mask: Mask | None) -> None:
        loop.reset(mask)
        clock.reset(mask)

    return advance, reset


def lines_of(task: Task[Any]) -> list[Path]:
    """Lines of a task's drawing."""
    return [
        Path(_host(line.points), _bytes(line.colour), max(1.0, line.width)) for line in task.contract.drawing().lines
    ]


def _bytes(colour: str) -> tuple[int, int, int]:
    from matplotlib.colors import to_rgb  # takes a while to import, and not every task draws

    red, green, blue = (round(255 * value) for value in to_rgb(colour))
    return red, green, blue


def _metrics(task: Task[Any], world: int) -> dict[str, float]:
    return {name.replace("_", " "): float(value[world]) for name, value in task.contract.metrics().items()}


def _trail(task: Task[Any]) -> Floats:
    place = task.contract.map_position()
    return np.zeros((task.num_worlds, 3)) if place is None else _host(place)


def _elements(task: Task[Any]) -> dict[str, Any]:
    """Force elements and sensors by name."""
    simulation = task.simulation
    if simulation is None:
        return {}
    found = {f"{type(element).__name__.lower()}_{index}": element for index, element in enumerate(simulation.elements)}
    return found | {sensor.name: sensor for sensor in simulation.sensors}


def _series(task: Task[Any], loop: TaskLoop) -> dict[str, Callable[[int], float]]:
    """Rewards, observations that are rows of numbers, and joints, of one world."""

    def reward(name: str) -> Callable[[int], float]:
        return lambda world: float(loop.rewards[name][world]) if name in loop.rewards else 0.0

    def observation(group: str, index: int) -> Callable[[int], float]:
        return lambda world: float(loop.observations()[group][world, index])

    found = {f"reward {name}": reward(name) for name in task.reward_terms}
    found["reward"] = lambda world: float(sum(terms[world] for terms in loop.rewards.values()))
    named = getattr(task, "observation_names", {})
    for group, shape in task.observation_shapes.items():
        if len(shape) == 1 and shape[0] <= MOST_OBSERVED:
            names = named.get(group) or [str(index) for index in range(shape[0])]
            found |= {f"{group} {name}": observation(group, index) for index, name in enumerate(names)}
    return found if task.simulation is None else found | joint_series(task.simulation)


def _host(tensor: torch.Tensor) -> Floats:
    values: Floats = tensor.detach().cpu().numpy()
    return values
