"""One row of the table: a scene in some number of worlds, timed, weighed and judged."""

from __future__ import annotations

import dataclasses
import functools
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import warp as wp

from simwarp.bench.health import Health, HealthCheck, MotionHealthCheck
from simwarp.bench.timing import Steppable, array_bytes, counted_launches, measure_speed
from simwarp.bench.workloads import BenchScene
from simwarp.core.memory import check_fits
from simwarp.core.types import ModelError
from simwarp.simulation.simulation import Simulation

_MIN_HORIZON_STEPS = 50
CALL_STEPS = 10
"""In one call of a run that is captured."""
_SEED = 2024
MOST_STEPS = 10**6
"""Before the timing."""


@dataclasses.dataclass
class Row:
    """Result for one number of worlds; rates are null unless `valid`.

    Attributes:
        engine: simwarp, or a peer with its version.
        scene, worlds, dt: workload that ran [dt in s].
        steps_per_s: world-steps per second (of a task: env steps), median of the repeats.
        steps_per_cpu_s: the same per second of the process' CPU time.
        steps_per_s_range, steps_per_cpu_s_range: lowest and highest repeat.
        residual: largest row residual at the ends of the motion [m/s or rad/s].
        position_error: largest joint violation there [m or rad].
        energy_gain: mechanical energy above the start's [J].
        tolerance: residual at which the solver stops [m/s or rad/s].
        contacts: that push, per world, at the ends of the motion; null without shapes.
        iterations: of the solver per world, there.
        penetration: deepest contact there [m].
        error: of the scene at rest against a known answer, as a share of it; null where there is none.
        launches_per_step: kernel launches that a step asks for, counted; those of the motion are left out.
        launches_beside_graph: of a control step that is captured, with torch's operations; null of other steps.
        bytes_per_world: growth of all device arrays with one more world.
        bytes_shared: device arrays that all worlds share.
        compile_s: from a model to the end of its first step [s].
        compile_source: process in which that was measured: `this process` or `cold process`.
        compile_cpu_s: CPU time of a cold process for it.
        compile_warm_s: `compile_s` of a new process with a filled kernel cache; only with a cold one.
        valid: True if the states were sound.
        problems: reasons why not.
        split: shares of the time of a task's step.
        threads: of a CPU that shared the worlds.
        vehicles: in each world of a convoy; null of others.
        cost_per_vehicle: of a step, as a share of the cost with one vehicle in each of as many worlds.
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
    tolerance: float | None = None
    contacts: float | None = None
    iterations: float | None = None
    penetration: float | None = None
    error: float | None = None
    launches_per_step: int | None = None
    launches_beside_graph: int | None = None
    bytes_per_world: int | None = None
    bytes_shared: int | None = None
    compile_s: float | None = None
    compile_source: str = "this process"
    compile_cpu_s: float | None = None
    compile_warm_s: float | None = None
    valid: bool = False
    problems: tuple[str, ...] = ()
    split: dict[str, float] | None = None
    threads: int = 1
    vehicles: int | None = None
    cost_per_vehicle: float | None = None

    def set_rates(self, speed: Any) -> None:
        """Fills the rates in."""
        walls, cpus = zip(*speed.repeats, strict=True)
        self.steps_per_s, self.steps_per_cpu_s = speed.steps_per_s, speed.steps_per_cpu_s
        self.steps_per_s_range, self.steps_per_cpu_s_range = (min(walls), max(walls)), (min(cpus), max(cpus))


class TimedRun:
    """A simulation in motion: steps, starts anew. Once captured, a call of `step` is several steps.

    Attributes:
        sim, worlds, dt: workload that runs.
        horizon_steps: calls of `step` until it starts anew.
        steps_per_call: steps in one call of `step`.
        motion_command: recorded launch before every step.
        settle_device: where motions run before they are timed: the model's own.
        examiner: judges the state; there once the start is set.
    """

    def __init__(self, sim: Simulation, horizon: float) -> None:
        self.sim = sim
        self.dt = sim.dt
        self.worlds = sim.model.world_count
        self.settle_device = str(sim.model.device)
        self.steps_per_call = 1
        self.horizon_steps = max(_MIN_HORIZON_STEPS, round(horizon / sim.dt))
        self.motion_command: Any = None
        self.examiner: HealthCheck
        self._call = self.single_step

    def set_motion(self) -> None:
        """Brings the worlds to their start."""
        raise NotImplementedError

    def single_step(self) -> None:
        """The motion's forces, then one step."""
        if self.motion_command is not None:
            self.motion_command.launch()
        self.sim.step()

    def _start_here(self, examiner: HealthCheck) -> None:
        self._start = self.sim.snapshot()
        self.examiner = examiner

    def _assign(self, settled: dict[str, Any]) -> None:
        """Hands the settled worlds out in turn; a leading dimension of 1 is shared by all of them."""
        for name, array in self._arrays().items():
            values = settled[name]
            if values.size:
                array.assign(np.take(values, np.arange(array.shape[0]) % len(values), axis=0))

    def _arrays(self) -> dict[str, Any]:
        """Everything that a step reads and changes, by name."""
        owners: dict[str, Any] = {"state": self.sim.state, "control": self.sim.control, "contacts": self.sim.contacts}
        found = {f"{key}.{name}": getattr(owner, name) for key, owner in owners.items() for name in owner.NAMES}
        return found | {f"memory.{index}": array for index, array in enumerate(self.sim.memory)}

    def capture(self) -> None:
        """Makes one call of several steps, as tasks do."""
        self._call = self._several_steps
        self.steps_per_call = CALL_STEPS
        self.horizon_steps = max(1, self.horizon_steps // CALL_STEPS)

    @functools.cached_property
    def _several_steps(self) -> Callable[[], None]:
        """A call of `CALL_STEPS` steps: a graph on CUDA, on a CPU a program."""
        device = self.sim.model.device
        if device.is_cuda:
            with wp.ScopedCapture(device=device) as capture:
                for _ in range(CALL_STEPS):
                    self.single_step()
            return lambda: wp.capture_launch(capture.graph)
        program = self.sim.program([] if self.motion_command is None else [self.motion_command])
        return lambda: program.run(CALL_STEPS)

    def advance(self, steps: int) -> None:
        """Makes so many steps, in calls of several: a GPU would wait for launches of single ones.

        The first step stays single, for it may load kernels, which a capture must not.
        """
        calls = max(0, steps - 1) // CALL_STEPS
        for _ in range(steps - calls * CALL_STEPS):
            self.single_step()
        for _ in range(calls):
            self._several_steps()

    def step(self) -> None:
        """`steps_per_call` steps."""
        self._call()

    def restart(self) -> None:
        """Back to the start."""
        self.sim.restore(self._start)

    def wait(self) -> None:
        """Until the device is done."""
        wp.synchronize_device(self.sim.model.device)


class SceneRun(TimedRun):
    """A scene in motion."""

    def __init__(self, scene: BenchScene, worlds: int, device: str | None, dt: float | None) -> None:
        self.scene = scene
        model = scene.build().finalize(world_count=worlds, device=device)
        step = scene.dt if dt is None else dt
        super().__init__(Simulation(model, dt=step, solver=scene.solver, check_start=False), scene.horizon)
        if scene.motion is not None:
            self.motion_command = scene.motion(self.sim, scene.variants)

    def set_motion(self) -> None:
        """Start and forces: world k gets the same ones whatever the number of worlds."""
        if self.scene.settle > 0.0:
            self._assign(_settled(self.scene, self.settle_device, self.dt))
        else:
            self._draw()
        self._start_with_examiner()

    def set_motion_of(self, other: SceneRun) -> None:
        """The start of another run of the same worlds."""
        other.restart()
        self._assign({name: array.numpy() for name, array in other._arrays().items()})
        self._start_with_examiner()

    def _start_with_examiner(self) -> None:
        scene = self.scene
        self._start_here(
            MotionHealthCheck(
                self.sim, energy_gain=scene.energy_gain, position_error=scene.position_error,
                penetration=scene.penetration,
            )
        )  # fmt: skip

    def settle(self) -> dict[str, Any]:
        """Runs the motion for as long as it settles: everything that a step reads, by name."""
        self._draw()
        self.advance(steps_before(self.scene.settle, self.dt))
        return {name: array.numpy().copy() for name, array in self._arrays().items()}

    def _draw(self) -> None:
        sim, dofs, bodies = self.sim, self.sim.model.dof_count, self.sim.model.body_count
        rng = np.random.default_rng(_SEED)
        draws = rng.uniform(-1.0, 1.0, (self.worlds, 2, max(dofs, 1)))[:, :, :dofs].astype(np.float32)
        if self.scene.start:
            sim.set_joint_state(None, draws[:, 0] * np.asarray(self.scene.start, np.float32), None)
        if self.scene.force:
            sim.control.joint_force.assign(draws[:, 1] * np.asarray(self.scene.force, np.float32))
        if self.scene.start_velocity:
            velocity = rng.uniform(-1.0, 1.0, (self.worlds, bodies, 3)) * self.scene.start_velocity
            sim.state.body_v.assign(velocity.astype(np.float32))
            sim.measure()


@functools.lru_cache(maxsize=2)
def _settled(scene: BenchScene, device: str, dt: float) -> dict[str, Any]:
    """All variants of a scene, settled; the same for every number of worlds."""
    return SceneRun(scene, scene.variants, device, dt).settle()


def steps_before(time: float, dt: float) -> int:
    """Steps that bring worlds to where the timing begins [s].

    Raises:
        ModelError: they would take hours.
    """
    steps = time / dt
    if steps > MOST_STEPS:
        raise ModelError(
            f"dt {dt:g} s: the {time:g} s of motion before the timing are {steps:.3g} steps, at most {MOST_STEPS:.0e} "
            "are made; use a larger dt"
        )
    return round(steps)


def measure_scene(scene: BenchScene, worlds: int, device: str | None, dt: float | None, seconds: float) -> Row:
    """Builds, steps, judges and times one scene.

    Raises:
        ModelError: no such device, dt is not usable, or the worlds do not fit into memory.
    """
    row = measure_run(scene.name, worlds, seconds, lambda count: SceneRun(scene, count, device, dt))
    if scene.error is not None and row.valid:
        row.error = scene.error(device)
    return row


def measure_run(name: str, worlds: int, seconds: float, make: Callable[[int], TimedRun]) -> Row:
    """Builds, steps, judges and times what `make` makes for a number of worlds.

    Raises:
        ModelError: the worlds do not fit into memory.
    """
    start = time.perf_counter()
    single = make(1)
    single.step()
    single.wait()
    row = Row("simwarp", name, worlds, single.dt, compile_s=time.perf_counter() - start)
    row.bytes_per_world, row.bytes_shared = bytes_of(lambda count: make(count).sim)
    check_memory(name, worlds, row.bytes_per_world, single.sim.model.device)
    run = make(worlds)
    run.set_motion()
    row.tolerance = run.sim.solver.tolerance
    with counted_launches() as launches:
        single.sim.step()
    row.launches_per_step = launches.total
    run.restart()
    run.capture()
    return time_and_judge(row, run, worlds * run.steps_per_call, seconds, run.examiner.examine, _rehearse(run))


def enter_cost_per_vehicle(rows: Sequence[Row]) -> None:
    """Compares rows of several vehicles in each world with that of one, of as many worlds and threads."""
    single = {(row.worlds, row.threads): row for row in rows if row.vehicles == 1}
    for row in rows:
        one = single.get((row.worlds, row.threads))
        if row.vehicles and one and one.steps_per_cpu_s and row.steps_per_cpu_s:
            row.cost_per_vehicle = one.steps_per_cpu_s / (row.vehicles * row.steps_per_cpu_s)


def _rehearse(run: TimedRun) -> Health:
    """One motion to its horizon, or for as long as patience lasts, before anything is timed."""
    run.restart()
    deadline = time.perf_counter() + 1.0
    for _ in range(run.horizon_steps):
        run.step()
        if time.perf_counter() > deadline:
            break
    return run.examiner.examine()


def time_and_judge(
    row: Row, run: Steppable, steps: int, seconds: float, examine: Callable[[], Health], first: Health | None = None
) -> Row:
    """Times what is sound at the start, and enters rates and the worst verdict.

    Args:
        row: of the run.
        run: what is timed.
        steps: in one call of `run.step`, of all worlds.
        seconds: altogether.
        examine: judges the present state.
        first: verdict before the timing; None: that on the present state.
    """
    verdicts = [examine() if first is None else first]
    if not verdicts[0].problems:
        row.set_rates(measure_speed(run, steps, seconds, lambda: verdicts.append(examine())))
    return judge(row, verdicts)


def judge(row: Row, verdicts: list[Health]) -> Row:
    """Enters the worst verdict; without a sound state there is no speed."""
    worst = verdicts[0]
    for other in verdicts[1:]:
        worst = worst.worse(other)
    row.residual, row.position_error, row.energy_gain = worst.residual, worst.position_error, worst.energy_gain
    row.penetration = worst.penetration
    row.contacts = _mean([verdict.contacts for verdict in verdicts])
    row.iterations = _mean([verdict.iterations for verdict in verdicts])
    row.problems = worst.problems
    row.valid = not worst.problems
    if not row.valid:
        row.steps_per_s = row.steps_per_cpu_s = row.steps_per_s_range = row.steps_per_cpu_s_range = row.split = None
    return row


def _mean(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def bytes_of(make: Callable[[int], object]) -> tuple[int, int]:
    """Bytes that one more world takes, and those that all share.

    Two worlds and three are compared: on a GPU the rows of a slot are padded as soon as there is a second world.

    Args:
        make: what owns the arrays, for a number of worlds.
    """
    two, three = array_bytes(make(2)), array_bytes(make(3))
    return three - two, 3 * two - 2 * three


def check_memory(name: str, worlds: int, per_world: int, device: Any) -> None:
    """Refuses more worlds than memory holds (beside a copy that the timing keeps to start anew).

    Raises:
        ModelError: they do not fit.
    """
    check_fits(f"{worlds} worlds of '{name}'", 2 * per_world * worlds, device, "use fewer worlds")
