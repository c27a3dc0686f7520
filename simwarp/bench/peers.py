"""Other engines on the same scene in the same run: MuJoCo C on the cart-pole, one thread, no Python in its loop.

Scenes with contacts have theirs in `contact_peers`, those with flexible bodies in `flexible_peers`.
"""

from __future__ import annotations

import importlib.util
import time

import numpy as np
import numpy.typing as npt

from simwarp.bench.contact_peers import CONTACT_SCENES, Measure, contact_peer_notes, contact_peers
from simwarp.bench.flexible_peers import FLEXIBLE_SCENES, flexible_peer_notes, flexible_peers
from simwarp.bench.health import Health
from simwarp.bench.measure import Row, SceneRun, time_and_judge
from simwarp.bench.mujoco_rollout import Rollout
from simwarp.bench.workloads import CART_MASS, POLE_INERTIA, POLE_MASS, RAIL, BenchScene

Array = npt.NDArray[np.float64]

PEER_SCENE = "pendulum"
AGREEMENT = 0.01
"""Largest difference of a coordinate from simwarp's after a second at 1 ms [m or rad]."""

_AGREEMENT_DT = 1e-3
_GRAVITY = 9.81
_OTHERS = {"mujoco_warp": "mujoco-warp", "newton": "newton"}

_XML = """
<mujoco>
  <option gravity="0 0 -{gravity}"/>
  <worldbody>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0" limited="true" range="-{rail} {rail}"/>
      <inertial pos="0 0 0" mass="{cart}" diaginertia="1 1 1"/>
      <body name="pole">
        <joint name="hinge" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 1" mass="{pole}" diaginertia="{inertia}"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="slide" gear="1"/></actuator>
</mujoco>
"""


def peer_notes(scene: str) -> list[str]:
    """Reasons why peers are missing from the table, one line each."""
    notes = []
    if scene in CONTACT_SCENES:
        return contact_peer_notes(scene)
    if scene in FLEXIBLE_SCENES:
        return flexible_peer_notes(scene)
    if scene != PEER_SCENE:
        there = ", ".join(f"'{name}'" for name in (PEER_SCENE, *CONTACT_SCENES))
        notes.append(f"peers: no other engine has a model of '{scene}' here; they have {there}")
    elif importlib.util.find_spec("mujoco") is None:
        notes.append("peer mujoco: not installed; pip install 'simwarp[import]'")
    for module, name in _OTHERS.items():
        if importlib.util.find_spec(module) is None:
            notes.append(f"peer {name}: not installed; pip install 'simwarp[peers]'")
        else:
            notes.append(f"peer {name}: installed, but this version has no comparison with it")
    return notes


def peer_measures(scene: str) -> list[Measure]:
    """Measurements of the engines that can stand beside this scene."""
    if scene in CONTACT_SCENES:
        return contact_peers(scene)
    if scene in FLEXIBLE_SCENES:
        return flexible_peers(scene)
    return [measure_mujoco] if scene == PEER_SCENE and importlib.util.find_spec("mujoco") is not None else []


class CartPoleRun(Rollout):
    """The cart-pole in MuJoCo C.

    Args:
        start: (W, 2) coordinates.
        force: (W,) on the cart [N].
        dt: step [s].
        horizon_steps: of one motion.
    """

    def __init__(self, start: Array, force: Array, dt: float, horizon_steps: int) -> None:
        inertia = " ".join(map(repr, POLE_INERTIA))
        text = _XML.format(gravity=_GRAVITY, rail=RAIL, cart=CART_MASS, pole=POLE_MASS, inertia=inertia)
        state = np.concatenate([np.zeros((len(start), 1)), start, np.zeros((len(start), 2))], axis=1)
        super().__init__(text, dt, state, horizon_steps)
        self.parts = [np.ascontiguousarray(force.reshape(-1, 1, 1))]

    @property
    def q(self) -> Array:
        """(W, 2) coordinates."""
        return self.now[:, 1:3]

    def energy(self) -> Array:
        """(W,) kinetic and potential [J]."""
        angle, v, rate = self.now[:, 2], self.now[:, 3], self.now[:, 4]
        kinetic = 0.5 * (CART_MASS + POLE_MASS) * v**2 + POLE_MASS * v * rate * np.cos(angle)
        kinetic += 0.5 * (POLE_INERTIA[1] + POLE_MASS) * rate**2
        return np.asarray(kinetic + POLE_MASS * _GRAVITY * np.cos(angle))


def differs_by(scene: BenchScene) -> float:
    """Largest difference of a coordinate [m or rad] between both engines, a second (of 1 ms steps) after one start."""
    steps = round(1.0 / _AGREEMENT_DT)
    ours = SceneRun(scene, 1, "cpu", _AGREEMENT_DT)
    ours.set_motion()
    theirs = CartPoleRun(*start_and_force(ours), _AGREEMENT_DT, steps)
    for _ in range(steps):
        ours.step()
    for _ in range(theirs.horizon_steps):
        theirs.step()
    return float(np.abs(ours.sim.state.joint_q.numpy() - theirs.q).max())


def start_and_force(run: SceneRun) -> tuple[Array, Array]:
    """Start coordinates and cart forces of a run that has just been set in motion."""
    q = run.sim.state.joint_q.numpy().astype(float)
    return q, run.sim.control.joint_force.numpy()[:, 0].astype(float)


def measure_mujoco(scene: BenchScene, worlds: int, device: str, dt: float | None, seconds: float) -> Row:
    """The same starts and forces in MuJoCo on the CPU, timed and judged in the same way."""
    import mujoco

    ours = SceneRun(scene, worlds, "cpu", dt)
    ours.set_motion()
    begin = time.perf_counter()
    run = CartPoleRun(*start_and_force(ours), ours.dt, ours.horizon_steps)
    mujoco.mj_step(run.model, run.data)
    row = Row(f"mujoco {mujoco.__version__}", scene.name, worlds, ours.dt, compile_s=time.perf_counter() - begin)
    row.bytes_per_world = run.bytes_per_world()
    run.restart()
    start_energy = run.energy()
    apart = differs_by(scene)

    def examine() -> Health:
        problems = []
        gain = float((run.energy() - start_energy).max())
        if not np.isfinite(run.now).all():
            problems.append("a state is not finite")
        elif scene.energy_gain is not None and not gain <= scene.energy_gain:
            problems.append(f"energy rose by {gain:.3g} J (sound: {scene.energy_gain:.3g} J)")
        if not apart <= AGREEMENT:
            problems.append(f"not the same motion as simwarp's: {apart:.2g} m or rad apart after 1 s at 1 ms")
        return Health(tuple(problems), 0.0, 0.0, gain, 0.0)

    time_and_judge(row, run, worlds * run.steps_per_call, seconds, examine)
    row.residual = row.position_error = None
    return row
