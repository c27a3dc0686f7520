"""Other engines on scenes with contacts, from the same starts and under the same motion.

MuJoCo C runs on one thread of the CPU with no Python in its loop, Newton there as it steps in Python. MuJoCo Warp runs
on the device that is measured: on a CPU as it steps in Python, on a GPU in graphs of as many steps as ours. Contact
models differ, and with them trajectories: what must agree are the mean height of the scene and how much of it touches.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import importlib.metadata
import importlib.util
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.bench.health import Health, pushing_contacts
from simwarp.bench.measure import CALL_STEPS, Row, SceneRun, time_and_judge
from simwarp.bench.motion import STACK_TORQUE, swing_targets, twist_torques
from simwarp.bench.motion_kernels import hold_swing_by_leg, write_swing
from simwarp.bench.mujoco_rollout import Rollout
from simwarp.bench.timing import array_bytes
from simwarp.bench.workloads import BenchScene
from simwarp.core.threads import thread_count

Array = npt.NDArray[np.float64]

ANT_FILE = Path(__file__).with_name("ant.xml")
HEIGHT_AGREEMENT = 0.03
"""Largest difference of the mean height of the watched bodies from simwarp's over one motion [m]."""
CONTACT_SHARE = 0.4
"""Largest difference of the mean number of contacts, as a share of simwarp's: soft contacts hop, rigid ones do not."""

CONTACT_SCENES = ("ant", "stack", "pile")

_WATCHED = {"ant": slice(0, 1), "stack": slice(9, 10), "pile": slice(None)}
"""The bodies whose mean height is compared: the torso, the topmost box, all balls."""
_OBSERVED_STEPS = 10
_ANT_DOFS = 8
_BOX_HALF = 0.25
_XPBD_ITERATIONS = 20


@dataclasses.dataclass(frozen=True)
class Start:
    """Initial states of the worlds, in MuJoCo's conventions.

    Attributes:
        time: (W,) of the motion [s].
        qpos: (W, nq) positions, wxyz quaternions, hinges.
        qvel: (W, nv) velocities, angular ones of free bodies in the body frame.
    """

    time: Array
    qpos: Array
    qvel: Array


class PeerRun(Protocol):
    """An engine in motion; see `timing.Steppable`."""

    horizon_steps: int
    steps_per_call: int

    def step(self) -> None:
        """`steps_per_call` steps."""

    def restart(self) -> None:
        """Back to the start."""

    def wait(self) -> None:
        """Until everything is done."""

    def heights(self) -> Array:
        """(W,) of the watched bodies, their mean [m]."""

    def contacts(self) -> float | None:
        """Contacts that touch now, mean of the worlds; None where the engine does not report them."""

    def bytes_per_world(self) -> int | None:
        """Of the engine's buffers."""


def start_of(run: SceneRun) -> Start:
    """The start of a run that has just been set in motion."""
    state, bodies = run.sim.state, 1 if run.scene.name == "ant" else run.sim.model.body_count
    x, rot = state.body_x.numpy().astype(float), state.body_rot.numpy().astype(float)
    v, omega = state.body_v.numpy().astype(float), state.body_omega.numpy().astype(float)
    axis, w = rot[..., :3], rot[..., 3:]
    twice = 2.0 * np.cross(-axis, omega)
    omega_b = omega + w * twice + np.cross(-axis, twice)
    qpos = np.concatenate([x, w, axis], axis=-1)[:, :bodies].reshape(run.worlds, -1)
    qvel = np.concatenate([v, omega_b], axis=-1)[:, :bodies].reshape(run.worlds, -1)
    if run.scene.name == "ant":
        by_leg = np.arange(_ANT_DOFS).reshape(2, -1).T.ravel()
        qpos = np.concatenate([qpos, state.joint_q.numpy()[:, by_leg]], axis=1)
        qvel = np.concatenate([qvel, state.joint_qd.numpy()[:, by_leg]], axis=1)
    return Start(state.world_time.numpy().copy(), qpos, qvel)


def model_text(name: str) -> str:
    """The scene as MJCF."""
    if name == "ant":
        return ANT_FILE.read_text(encoding="utf-8")
    return _stack_text() if name == "stack" else _pile_text()


def _pile_text(side: int = 6) -> str:
    balls = '<body><freejoint/><geom type="sphere" size="0.1" mass="10"/></body>' * side**3
    return (
        '<mujoco><option gravity="0 0 -9.81"/><default><geom friction="0.5 0 0"/></default><worldbody>'
        f'<geom type="plane" size="50 50 1"/>{balls}</worldbody></mujoco>'
    )


def _stack_text(count: int = 10) -> str:
    boxes = "".join(
        f'<body pos="0 0 {(2 * level + 1) * _BOX_HALF}"><freejoint/>'
        f'<geom type="box" size="{_BOX_HALF} {_BOX_HALF} {_BOX_HALF}" mass="1"/></body>'
        for level in range(count)
    )
    return (
        '<mujoco><option gravity="0 0 -9.81"/><default><geom friction="0.5 0 0"/></default><worldbody>'
        f'<geom type="plane" size="50 50 1"/>{boxes}</worldbody></mujoco>'
    )


class MuJoCoRun(Rollout):
    """MuJoCo C under the motion of a scene."""

    def __init__(self, scene: BenchScene, start: Start, dt: float, horizon_steps: int, observed: bool) -> None:
        state = np.concatenate([start.time[:, None], start.qpos, start.qvel], axis=1)
        super().__init__(model_text(scene.name), dt, state, horizon_steps, _OBSERVED_STEPS if observed else None)
        self._heights = np.arange(3, 1 + self.model.nq, 7)[_WATCHED[scene.name]]
        times = start.time[:, None] + dt * np.arange(self.horizon_steps * self.steps_per_call)
        if scene.name == "ant":
            inputs = swing_targets(times, _ANT_DOFS, self.worlds, scene.variants)
        elif scene.motion is None:
            inputs = np.zeros((*times.shape, 0))
        else:
            torque = twist_torques(times, STACK_TORQUE, self.worlds, scene.variants)
            wrench = np.zeros((*torque.shape, self.model.nbody, 6))
            wrench[:, :, 1:, 5] = torque[:, :, None]
            inputs = wrench.reshape(*torque.shape, -1)
            self.spec = self.mujoco.mjtState.mjSTATE_XFRC_APPLIED.value
        calls = range(0, inputs.shape[1], self.steps_per_call)
        self.parts = [np.ascontiguousarray(inputs[:, at : at + self.steps_per_call]) for at in calls]

    def heights(self) -> Array:
        """(W,) of the watched bodies, their mean [m]."""
        return np.asarray(self.now[:, self._heights].mean(axis=1))

    def contacts(self) -> float:
        """Touching now, mean of the worlds."""
        count = 0
        for state in self.now:
            self.mujoco.mj_setState(self.model, self.data, state, self.mujoco.mjtState.mjSTATE_FULLPHYSICS)
            self.mujoco.mj_forward(self.model, self.data)
            count += self.data.ncon
        return count / self.worlds


class MjBatchRun:
    """MuJoCo C on the threads of mjbatch, a batch at a time."""

    steps_per_call = 1

    def __init__(self, scene: BenchScene, start: Start, dt: float, horizon_steps: int, observed: bool) -> None:
        import mujoco

        mjbatch: Any = importlib.import_module("mjbatch")
        model = mujoco.MjModel.from_xml_string(model_text(scene.name))
        model.opt.timestep = dt
        self.worlds, self.horizon_steps, self._model = len(start.time), horizon_steps, model
        self._batch: Any = mjbatch.Batch(model, self.worlds, num_threads=thread_count())
        self._fields = {name: self._batch.bind(name) for name in ("time", "qpos", "qvel", "ctrl", "qacc_warmstart")}
        times = start.time[:, None] + dt * np.arange(horizon_steps)
        self._targets = swing_targets(times, _ANT_DOFS, self.worlds, scene.variants)
        self._start = start
        self.restart()

    def restart(self) -> None:
        """Back to the start."""
        for name in ("time", "qpos", "qvel"):
            values = getattr(self._start, name)
            self._fields[name][:] = values.reshape(self._fields[name].shape)
        self._fields["qacc_warmstart"][:] = 0.0
        self._turn = 0

    def step(self) -> None:
        """One step of all worlds."""
        self._fields["ctrl"][:] = self._targets[:, self._turn % self.horizon_steps]
        self._turn += 1
        self._batch.step()

    def wait(self) -> None:
        """Nothing to wait for on a CPU."""

    def heights(self) -> Array:
        """(W,) of the torso [m]."""
        return np.asarray(self._fields["qpos"][:, 2], float)

    def contacts(self) -> None:
        """None: the engine does not hand them out."""

    def bytes_per_world(self) -> int:
        """Of its state; MuJoCo's data are of the threads."""
        return 8 * int(self._batch.nstate)


class MuJoCoWarpRun:
    """MuJoCo Warp on a device; its targets are written by the kernel that simwarp's motion uses."""

    def __init__(
        self, scene: BenchScene, start: Start, dt: float, horizon_steps: int, observed: bool, device: str = "cpu"
    ) -> None:
        import mujoco
        import mujoco_warp

        self._step = mujoco_warp.step
        self._device = wp.get_device(device)
        host = mujoco.MjModel.from_xml_string(model_text(scene.name))
        host.opt.timestep = dt
        data = mujoco.MjData(host)
        mujoco.mj_forward(host, data)
        self.worlds, self.horizon_steps, self.steps_per_call = len(start.time), horizon_steps, 1
        with wp.ScopedDevice(self._device):
            self.model: Any = mujoco_warp.put_model(host)
            self.data: Any = mujoco_warp.put_data(host, data, nworld=self.worlds, nconmax=8, njmax=48)
        self._start = start
        self._motion = wp.launch(
            write_swing, dim=self.worlds, device=self._device, record_cmd=True,
            inputs=[scene.variants, self.data.time], outputs=[self.data.ctrl],
        )  # fmt: skip
        self.restart()
        self._call = self._single_step
        if self._device.is_cuda and not observed:
            self._capture()

    def _capture(self) -> None:
        """Makes one call a graph of `CALL_STEPS` steps: one by one their launches would be what is measured."""
        self._single_step()  # a capture must not load kernels
        with wp.ScopedCapture(device=self._device) as capture:
            for _ in range(CALL_STEPS):
                self._single_step()
        self._call = functools.partial(wp.capture_launch, capture.graph)
        self.steps_per_call, self.horizon_steps = CALL_STEPS, max(1, self.horizon_steps // CALL_STEPS)
        self.restart()

    def restart(self) -> None:
        """Back to the start."""
        for name in ("time", "qpos", "qvel"):
            getattr(self.data, name).assign(getattr(self._start, name).astype(np.float32))
        self.data.qacc_warmstart.zero_()

    def _single_step(self) -> None:
        with wp.ScopedDevice(self._device):
            self._motion.launch()
            self._step(self.model, self.data)

    def step(self) -> None:
        """`steps_per_call` steps of all worlds."""
        self._call()

    def wait(self) -> None:
        """Until the device is done."""
        wp.synchronize_device(self._device)

    def heights(self) -> Array:
        """(W,) of the torso [m]."""
        return np.asarray(self.data.qpos.numpy()[:, 2], float)

    def contacts(self) -> float:
        """Touching now, mean of the worlds."""
        return float(self.data.nacon.numpy()[0]) / self.worlds

    def bytes_per_world(self) -> int:
        """Of its data arrays."""
        arrays = [value for value in vars(self.data).values() if isinstance(value, wp.array)]
        return array_bytes(arrays) // self.worlds


class NewtonRun:
    """Newton's XPBD solver under the torques of the motion; with fewer iterations it does not carry the ant."""

    steps_per_call = 1

    def __init__(self, scene: BenchScene, start: Start, dt: float, horizon_steps: int, observed: bool) -> None:
        import newton

        self._newton: Any = newton
        self.worlds, self.horizon_steps, self.dt = len(start.time), horizon_steps, dt
        single = newton.ModelBuilder()
        single.add_mjcf(model_text(scene.name))
        worlds = newton.ModelBuilder()
        worlds.replicate(single, self.worlds)
        with wp.ScopedDevice("cpu"):
            self.model: Any = worlds.finalize()
            self.model.joint_target_ke.zero_()
            self.model.joint_target_kd.zero_()
            self.solver = newton.solvers.SolverXPBD(self.model, iterations=_XPBD_ITERATIONS)
            self.states = [self.model.state(), self.model.state()]
            self.control = self.model.control()
            self.found = self.model.contacts()
            self._joint_q, self._joint_qd = wp.zeros_like(self.model.joint_q), wp.zeros_like(self.model.joint_qd)
            self._time = wp.zeros(self.worlds, dtype=wp.float32, device="cpu")
        self._bodies = self.model.body_count // self.worlds
        qpos = start.qpos.copy()
        qpos[:, 3:7] = np.roll(start.qpos[:, 3:7], -1, axis=1)  # wxyz to xyzw
        self._start = [values.astype(np.float32) for values in (qpos.ravel(), start.qvel.ravel(), start.time)]
        shape = (self.worlds, -1)
        self._motion = wp.launch(
            hold_swing_by_leg, dim=self.worlds, device="cpu", record_cmd=True,
            inputs=[scene.variants, self._time, self._joint_q.reshape(shape), self._joint_qd.reshape(shape)],
            outputs=[self.control.joint_f.reshape(shape)],
        )  # fmt: skip
        self.restart()

    def restart(self) -> None:
        """Back to the start."""
        self.model.joint_q.assign(self._start[0])
        self.model.joint_qd.assign(self._start[1])
        self._time.assign(self._start[2])
        for state in self.states:
            self._newton.eval_fk(self.model, self.model.joint_q, self.model.joint_qd, state)

    def step(self) -> None:
        """One step of all worlds."""
        now, later = self.states
        with wp.ScopedDevice("cpu"):
            self._newton.eval_ik(self.model, now, self._joint_q, self._joint_qd)
            self._motion.launch()
            now.clear_forces()
            self.model.collide(now, self.found)
            self.solver.step(now, later, self.control, self.found, self.dt)
        self.states = [later, now]
        self._time.numpy()[:] += np.float32(self.dt)

    def wait(self) -> None:
        """Nothing to wait for on a CPU."""

    def heights(self) -> Array:
        """(W,) of the torso [m]."""
        return np.asarray(self.states[0].body_q.numpy().reshape(self.worlds, self._bodies, 7)[:, 0, 2], float)

    def contacts(self) -> None:
        """None: the engine reports candidates only."""

    def bytes_per_world(self) -> None:
        """Not counted."""


Measure = Callable[[BenchScene, int, str, float | None, float], Row]
"""Of a scene, a number of worlds, the device that is measured, its step [s] and the time to measure for [s]."""

_ENGINES: dict[str, tuple[str, type[Any], tuple[str, ...]]] = {
    "mujoco": ("mujoco", MuJoCoRun, ("ant", "stack", "pile")),
    "mjbatch": ("mjbatch", MjBatchRun, ("ant",)),
    "mujoco_warp": ("mujoco-warp", MuJoCoWarpRun, ("ant",)),
    "newton": ("newton", NewtonRun, ("ant",)),
}
_ON_ANY_DEVICE = ("mujoco_warp",)
"""Engines that run where we do; the others are measured on the CPU, whatever our device."""


def contact_peers(scene: str) -> list[Measure]:
    """Measurements of the engines that are installed and have the scene."""
    return [
        functools.partial(measure_peer, module)
        for module, (_, _, names) in _ENGINES.items()
        if scene in names and importlib.util.find_spec(module) is not None
    ]


def contact_peer_notes(scene: str) -> list[str]:
    """Reasons why engines are missing from the table, one line each."""
    notes = []
    for module, (name, _, names) in _ENGINES.items():
        extra = "import" if module == "mujoco" else "peers"
        if scene not in names:
            notes.append(f"peer {name}: this version has no comparison with it on '{scene}'")
        elif importlib.util.find_spec(module) is None:
            notes.append(f"peer {name}: not installed; pip install 'simwarp[{extra}]'")
    return notes


@functools.lru_cache(maxsize=4)
def our_motion(scene: BenchScene, dt: float | None) -> tuple[float, float]:
    """Mean height of the watched bodies [m] and mean number of contacts over one motion, in simwarp."""
    run = SceneRun(scene, scene.variants, "cpu", dt)
    run.set_motion()
    heights, contacts = [], []
    for _ in range(run.horizon_steps):
        run.step()
        heights.append(run.sim.state.body_x.numpy()[:, _WATCHED[scene.name], 2].mean())
        contacts.append(pushing_contacts(run.sim))
    return float(np.mean(heights)), float(np.mean(contacts))


@functools.lru_cache(maxsize=4)
def their_motion(module: str, scene: BenchScene, dt: float | None, device: str) -> tuple[float, float | None]:
    """The same of a peer, from the same starts."""
    ours = SceneRun(scene, scene.variants, "cpu", dt)
    ours.set_motion()
    run = _peer_run(module, scene, ours, device, observed=True)
    heights: list[float] = []
    contacts: list[float] = []
    for _ in range(run.horizon_steps):
        run.step()
        heights.append(float(run.heights().mean()))
        found = run.contacts()
        if found is not None:
            contacts.append(found)
    return float(np.mean(heights)), float(np.mean(contacts)) if contacts else None


def disagreement(scene: BenchScene, dt: float | None, theirs: tuple[float, float | None]) -> list[str]:
    """Differences between the peer's motion and ours, in words; empty when they agree."""
    problems = []
    height, contacts = our_motion(scene, dt)
    if not abs(theirs[0] - height) <= HEIGHT_AGREEMENT:
        problems.append(f"not the same motion as simwarp's: mean height {theirs[0]:.3f} m, not {height:.3f} m")
    # how many contacts two faces have is a choice of the engine; feet have one each
    if scene.name == "ant" and theirs[1] is not None and not abs(theirs[1] - contacts) <= CONTACT_SHARE * contacts:
        problems.append(f"not the same motion as simwarp's: {theirs[1]:.1f} contacts on average, not {contacts:.1f}")
    return problems


def _peer_run(module: str, scene: BenchScene, ours: SceneRun, device: str, *, observed: bool) -> PeerRun:
    """A peer at the start of a run of ours; `device` is for those in `_ON_ANY_DEVICE`."""
    kind = _ENGINES[module][1]
    more = (device,) if module in _ON_ANY_DEVICE else ()
    run: PeerRun = kind(scene, start_of(ours), ours.dt, ours.horizon_steps, observed, *more)
    return run


def measure_peer(module: str, scene: BenchScene, worlds: int, device: str, dt: float | None, seconds: float) -> Row:
    """The same starts and motion in another engine, timed in the same way and judged by the motion."""
    name = _ENGINES[module][0]
    ours = SceneRun(scene, worlds, "cpu", dt)
    ours.set_motion()
    engine = f"{name} {importlib.metadata.version(name)}" + (" XPBD" if module == "newton" else "")
    if module in _ON_ANY_DEVICE and wp.get_device(device).is_cuda:
        engine += f" on {device}"
    begin = time.perf_counter()
    run = _peer_run(module, scene, ours, device, observed=False)
    run.step()
    run.wait()
    row = Row(engine, scene.name, worlds, ours.dt, compile_s=time.perf_counter() - begin)
    row.bytes_per_world = run.bytes_per_world()
    theirs = their_motion(module, scene, dt, device)
    problems = disagreement(scene, dt, theirs)

    def examine() -> Health:
        found = [] if np.isfinite(run.heights()).all() else ["a state is not finite"]
        return Health(tuple(problems + found), 0.0, 0.0, 0.0, 0.0, contacts=theirs[1])

    time_and_judge(row, run, worlds * run.steps_per_call, seconds, examine)
    row.residual = row.position_error = row.energy_gain = None
    return row
