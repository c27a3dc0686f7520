"""A task's row: environment steps with random actions, and what their time goes to."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any
from unittest import mock

import torch
import warp as wp

from simwarp.bench.health import Health
from simwarp.bench.measure import Row, bytes_of, check_memory, judge
from simwarp.bench.timing import counted_launches, measure_speed
from simwarp.core.memory import check_fits
from simwarp.simulation.step_program import timed_phases
from simwarp.tasks import TaskError, check_step, make, replace_fields, resolve_device, task_class
from simwarp.tasks.framework.task import NON_FINITE

_HORIZON_STEPS = 1000
_ACTIONS = 16
_SPLIT_STEPS, _SPLIT_SECONDS = 200, 10.0


class TaskRun:
    """A task under random actions; an episode that ends starts anew inside the step."""

    horizon_steps = _HORIZON_STEPS

    def __init__(self, name: str, worlds: int, device: str, config: Any) -> None:
        self.task = make(name, worlds, device=device, config=config)
        self.task.keep_final_observations = False
        generator = torch.Generator().manual_seed(0)
        shape = (_ACTIONS, *self.task.action.shape)
        self._actions = (2.0 * torch.rand(shape, generator=generator) - 1.0).to(self.task.device)
        self._turn = 0

    def step(self) -> None:
        """One control step."""
        self._turn = (self._turn + 1) % _ACTIONS
        self.task.step(self._actions[self._turn])

    def restart(self) -> None:
        """New episodes everywhere."""
        self.task.restart(seed=0)

    def wait(self) -> None:
        """Until the device is done."""
        if self.task.device.type == "cuda":
            torch.cuda.synchronize(self.task.device)

    def examine(self) -> Health:
        """A task has no fixed motion: no world may have broken down, and every number it hands out is finite."""
        problems = []
        try:
            broken = self.task.drain_statistics().end_reasons.get(NON_FINITE, 0)
        except TaskError as error:
            broken = 0
            problems.append(str(error))
        if broken:
            problems.append(f"{broken} episodes ended in a state that is not finite")
        if not all(bool(torch.isfinite(group).all()) for group in self.task.contract.observations().values()):
            problems.append("an observation is not finite")
        sim = self.task.simulation
        if sim is None:
            return Health(tuple(problems), 0.0, 0.0, 0.0, 0.0)
        reports = sim.diagnostics
        residual = max(float(reports.row_residual.numpy().max()), float(reports.cone_residual.numpy().max()))
        if not residual <= 1e-2:
            problems.append(f"row residual {residual:.2g} m/s")
        return Health(tuple(problems), residual, float(reports.position_error.numpy().max()), 0.0, 0.0)

    def split(self) -> dict[str, float]:
        """Shares of the time of a step in which a policy acts: physics, sensors, the policy's network (that which
        `simwarp train` would make), and the task around them: actions, rewards, observations, resets.
        """
        policy, acting_s = self._policy(), 0.0

        def act() -> None:
            nonlocal acting_s
            self.wait()
            start = time.perf_counter()
            policy(self.task.observe())
            self.wait()
            acting_s += time.perf_counter() - start

        captured = not self.task.not_captured
        # a step that is replayed from a graph calls no program: its parts are timed in steps without
        with timed_phases(self.wait) as times, mock.patch.object(self.task, "capture", False):
            steps, total = self._acting_steps(act)
        shares = {phase.value: seconds / steps for phase, seconds in times.seconds.items()}
        shares["policy"] = acting_s / steps
        whole = total / steps
        if captured:
            steps, total = self._acting_steps(act)
            whole = total / steps
        shares["task"] = max(0.0, whole - sum(shares.values()))
        whole = sum(shares.values())
        return {part: shares[part] / whole for part in ("physics", "sensors", "task", "policy")}

    def _acting_steps(self, act: Callable[[], None]) -> tuple[int, float]:
        """Steps in which a policy acts: how many, and how long they took [s]."""
        self.wait()
        begin = time.perf_counter()
        steps = 0
        while steps < _SPLIT_STEPS and time.perf_counter() - begin < _SPLIT_SECONDS:
            self.step()
            act()
            steps += 1
        self.wait()
        return steps, time.perf_counter() - begin

    def _policy(self) -> Callable[[dict[str, torch.Tensor]], None]:
        """A network such as training makes, untrained."""
        from tensordict import TensorDict

        from simwarp.train.config import default_config
        from simwarp.train.networks.policies import build_actor
        from simwarp.train.networks.symmetric import task_settings

        task = self.task
        actor = build_actor(task_settings(task, default_config(type(task), task.config)), task)

        def act(observations: dict[str, torch.Tensor]) -> None:
            with torch.inference_mode():
                actor(TensorDict(dict(observations), batch_size=[task.num_worlds]))

        return act


def measure_task(name: str, worlds: int, device: str, dt: float | None, seconds: float, obs: str | None = None) -> Row:
    """Times a task; launches and rates are those of a control step.

    Raises:
        InputError: no such device, or the task refuses the configuration.
        ModelError: the worlds do not fit into memory.
    """
    torch.set_num_threads(1)
    config = task_class(name).config_type()
    if obs is not None:
        config = replace_fields(config, {"obs": obs})
    if dt is not None:
        config = replace_fields(config, {"dt": dt})
    start = time.perf_counter()
    single = TaskRun(name, 1, device, config)
    single.step()
    single.wait()
    row = Row("simwarp", name, worlds, config.dt, compile_s=time.perf_counter() - start)
    # drawn in double precision, scaled, and kept
    actions = 3 * 8 * _ACTIONS * worlds * single.task.action_size
    check_fits(f"actions of {worlds} worlds of '{name}'", actions, wp.get_device("cpu"), "use fewer worlds")
    if single.task.simulation is not None:
        row.bytes_per_world, row.bytes_shared = bytes_of(
            lambda count: TaskRun(name, count, device, config).task.simulation
        )
        check_memory(name, worlds, row.bytes_per_world, single.task.simulation.model.device)
    run = TaskRun(name, worlds, device, config)
    with counted_launches() as launches:
        single.step()
    row.launches_per_step = launches.total
    if not single.task.not_captured:
        beside = check_step(single.task).total
        row.launches_beside_graph = None if single.task.not_captured else round(beside)
    verdicts: list[Health] = []
    speed = measure_speed(run, worlds, seconds, lambda: verdicts.append(run.examine()))
    row.set_rates(speed)
    run.restart()
    row.split = run.split()
    return judge(row, verdicts)


def task_device(name: str) -> str:
    """The canonical name of a device, as tasks take it."""
    return resolve_device(name)
