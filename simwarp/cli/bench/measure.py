"""One row of the table: a scene in some number of worlds, timed, weighed and judged."""

from __future__ import annotations

import dataclasses
import os
import time
from typing import Any

import numpy as np
import warp as wp

from simwarp.cli.bench.health import Examiner, Health
from simwarp.cli.bench.timing import array_bytes, counted_launches, measure_speed
from simwarp.cli.bench.workloads import BenchScene
from simwarp.simulation import Simulation
from simwarp.types import ModelError

_MIN_HORIZON_STEPS = 50
_GRAPH_STEPS = 10
_SEED = 2024


@dataclasses.dataclass
class Row:
    """Result for one number of worlds; rates are null unless `valid`.

    Attributes:
        engine: simwarp, or a peer with its version.
        scene, worlds, dt: what ran [dt in s].
        steps_per_s: world-steps per second (of a task: env steps), median of the repeats.
        steps_per_cpu_s: the same per second of the process' CPU time.
        steps_per_s_range, steps_per_cpu_s_range: lowest and highest repeat.
        residual: largest row residual at the ends of the motion [m/s or rad/s].
        position_error: largest joint violation there [m or rad].
        energy_gain: mechanical energy above the start's [J].
        launches_per_step: kernel launches that a step asks for, counted.
        bytes_per_world: growth of all device arrays with one more world.
        bytes_shared: device arrays that all worlds share.
        compile_s: from a model to the end of its first step [s].
        compile_source: where that was seen: `this process` or `cold process`.
        compile_cpu_s: CPU time of a cold process for it.
        compile_warm_s: `compile_s` of a new process with a filled kernel cache; only with a cold one.
        valid: whether the states were sound.
        problems: why not.
        split: shares of the time of a task's step.
    """

    engine: str
    scene: str
    worlds: int
    dt: float
    steps_per_s: float | None = None
    steps_per_cpu_s: float | None = None
    steps_per_s_range: tuple[float, float] | None = None
    steps_per_cpu_s_range: tuple[float, float] | None = None
    residual: float | None = None
    position_error: float | None = None
    energy_gain: float | None = None
    launches_per_step: int | None = None
    bytes_per_world: int | None = None
    bytes_shared: int | None = None
    compile_s: float | None = None
    compile_source: str = "this process"
    compile_cpu_s: float | None = None
    compile_warm_s: float | None = None
    valid: bool = False
    problems: tuple[str, ...] = ()
    split: dict[str, float] | None = None

    def take_speed(self, speed: Any) -> None:
        """Fills the rates in."""
        walls, cpus = zip(*speed.repeats, strict=True)
        self.steps_per_s, self.steps_per_cpu_s = speed.steps_per_s, speed.steps_per_cpu_s
        self.steps_per_s_range, self.steps_per_cpu_s_range = (min(walls), max(walls)), (min(cpus), max(cpus))


class SceneRun:
    """A scene in motion: starts, steps, starts anew. On CUDA, `step` replays a captured graph of several steps."""

    def __init__(self, scene: BenchScene, worlds: int, device: str | None, dt: float | None) -> None:
        self.scene = scene
        self.dt = scene.dt if dt is None else dt
        self.sim = Simulation(scene.build().finalize(world_count=worlds, device=device), dt=self.dt)
        self.worlds = worlds
        self.steps_per_call = 1
        self.horizon_steps = max(_MIN_HORIZON_STEPS, round(scene.horizon / self.dt))
        self._call = self.sim.step

    def set_motion(self) -> None:
        """Start and forces: world k gets the same ones whatever the number of worlds."""
        sim, dofs = self.sim, self.sim.model.dof_count
        rng = np.random.default_rng(_SEED)
        draws = rng.uniform(-1.0, 1.0, (self.worlds, 2, max(dofs, 1)))[:, :, :dofs].astype(np.float32)
        if self.scene.start:
            sim.set_joint_state(None, draws[:, 0] * np.asarray(self.scene.start, np.float32), None)
        if self.scene.force:
            sim.control.joint_force.assign(draws[:, 1] * np.asarray(self.scene.force, np.float32))
        self._start = sim.snapshot()
        self.examiner = Examiner(sim, energy_gain=self.scene.energy_gain, position_error=self.scene.position_error)

    def capture(self) -> None:
        """On CUDA, records a graph of several steps; elsewhere nothing."""
        device = self.sim.model.device
        if not device.is_cuda:
            return
        with wp.ScopedCapture(device=device) as capture:
            for _ in range(_GRAPH_STEPS):
                self.sim.step()
        self.steps_per_call = _GRAPH_STEPS
        self.horizon_steps = max(1, self.horizon_steps // _GRAPH_STEPS)
        self._call = lambda: wp.capture_launch(capture.graph)

    def step(self) -> None:
        """`steps_per_call` steps."""
        self._call()

    def restart(self) -> None:
        """Back to the start."""
        self.sim.restore(self._start)

    def wait(self) -> None:
        """Until the device is done."""
        wp.synchronize_device(self.sim.model.device)


def measure_scene(scene: BenchScene, worlds: int, device: str | None, dt: float | None, seconds: float) -> Row:
    """Builds, steps, judges and times one scene.

    Raises:
        ModelError: no such device, dt is not usable, or the worlds do not fit into memory.
    """
    start = time.perf_counter()
    single = SceneRun(scene, 1, device, dt)
    single.step()
    single.wait()
    row = Row("simwarp", scene.name, worlds, single.dt, compile_s=time.perf_counter() - start)
    row.bytes_per_world, row.bytes_shared = bytes_of(single.sim, SceneRun(scene, 2, device, dt).sim)
    check_memory(scene.name, worlds, row.bytes_per_world, single.sim.model.device)
    run = SceneRun(scene, worlds, device, dt)
    run.set_motion()
    with counted_launches() as launches:
        run.step()
    row.launches_per_step = launches.total
    run.restart()
    run.capture()
    verdicts = [_rehearse(run)]
    if not verdicts[0].problems:
        speed = measure_speed(
            run, worlds * run.steps_per_call, seconds, lambda: verdicts.append(run.examiner.examine())
        )
        row.take_speed(speed)
    return judge(row, verdicts)


def _rehearse(run: SceneRun) -> Health:
    """One motion to its horizon, or for as long as patience lasts, before anything is timed."""
    run.restart()
    deadline = time.perf_counter() + 1.0
    for _ in range(run.horizon_steps):
        run.step()
        if time.perf_counter() > deadline:
            break
    return run.examiner.examine()


def judge(row: Row, verdicts: list[Health]) -> Row:
    """Enters the worst verdict; without a sound state there is no speed."""
    worst = verdicts[0]
    for other in verdicts[1:]:
        worst = worst.worse(other)
    row.residual, row.position_error, row.energy_gain = worst.residual, worst.position_error, worst.energy_gain
    row.problems = worst.problems
    row.valid = not worst.problems
    if not row.valid:
        row.steps_per_s = row.steps_per_cpu_s = row.steps_per_s_range = row.steps_per_cpu_s_range = row.split = None
    return row


def bytes_of(one: Simulation, two: Simulation) -> tuple[int, int]:
    """Bytes that one more world takes, and those that all share, from simulations of one and of two worlds."""
    first, second = array_bytes(one), array_bytes(two)
    return second - first, 2 * first - second


def check_memory(name: str, worlds: int, per_world: int, device: Any) -> None:
    """Refuses more worlds than memory holds (beside a copy that the timing keeps to start anew).

    Raises:
        ModelError: they do not fit.
    """
    there = int(device.total_memory) if device.is_cuda else os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    needed = 2 * per_world * worlds
    if needed > there:
        raise ModelError(
            f"{worlds} worlds of '{name}' need {needed / 2**30:.0f} GiB, device {device} has {there / 2**30:.0f} GiB; "
            "use fewer worlds"
        )
