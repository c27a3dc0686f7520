"""MuJoCo on scenes with flexible bodies: the same sizes, materials and steps in its flexes, errors beside speeds.

MuJoCo gives every vertex the same mass, and clamps a rod halfway before the second of two pins. Its errors are against
what theory says of that: what is told is the error of elements and solver, not that of the loads.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib.util
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp import scenes
from simwarp.bench.health import Health
from simwarp.bench.measure import Row, time_and_judge
from simwarp.bench.mujoco_rollout import Rollout
from simwarp.bench.workloads import BenchScene

Array = npt.NDArray[np.float64]

GRAVITY: Final = 9.81
CELLS: Final = 20
"""Edges of the rod that move."""
REST: Final = 4000
"""Steps after which a damped flex is at rest."""
STILL: Final = 1e-3
"""Speed below which it is [m/s]."""
CALL_STEPS: Final = 50
"""In one call, of each world."""
INTEGRATOR: Final = "discrete"
"""Of MuJoCo: the one that takes the elasticity of flexes implicitly. Its solver CG is the faster one with it."""

_XML: Final = """<mujoco><option gravity="0 0 -{gravity}" integrator="{integrator}" solver="CG"/><worldbody>{floor}
<flexcomp name="flex" type="grid" count="{count}" spacing="{spacing} {spacing} {spacing}" dim="{dim}" mass="{mass}"
 radius="{radius}" pos="{place}">{pin}
<elasticity young="{young}" poisson="{poisson}" damping="{damping}" {sheet}/>{edge}
<contact selfcollide="none" {contact}/></flexcomp></worldbody></mujoco>"""
_FLOOR: Final = '<geom type="plane" size="50 50 1" friction="{friction} 0 0"/>'
_NO_CONTACT: Final = 'contype="0" conaffinity="0"'


@dataclasses.dataclass(frozen=True)
class FlexiblePeer:
    """A scene in MuJoCo.

    Attributes:
        moving: as it is timed, as MJCF.
        resting: damped and held so that theory has an answer.
        error: of places (n, 3) of its vertices at rest from that answer, as a share of it; of those as built and there.
    """

    moving: str
    resting: str
    error: Callable[[Array, Array], float]


def flexible_peer_notes(scene: str) -> list[str]:
    """Reasons why engines are missing from the table, one line each."""
    notes = []
    if scene not in PEERS:
        there = ", ".join(f"'{name}'" for name in PEERS)
        notes.append(f"peers: no other engine has a model of '{scene}' here; of flexible scenes they have {there}")
    elif importlib.util.find_spec("mujoco") is None:
        notes.append("peer mujoco: not installed; pip install 'simwarp[import]'")
    if scene in ("rod", "rod-on-floor"):
        installed = importlib.util.find_spec("elastica") is not None
        what = "installed, but this version has no comparison with it" if installed else "not installed"
        notes.append(f"peer pyelastica: {what}")
    return notes


def flexible_peers(scene: str) -> list[Callable[..., Row]]:
    """Measurements of the engines that are installed and have the scene."""
    return [measure_flex] if scene in PEERS and importlib.util.find_spec("mujoco") is not None else []


def measure_flex(scene: BenchScene, worlds: int, device: str, dt: float | None, seconds: float) -> Row:
    """The scene in MuJoCo on the CPU, from its start at rest, timed in the same way, with its own error at rest."""
    import mujoco

    step, peer = scene.dt if dt is None else dt, PEERS[scene.name]()
    begin = time.perf_counter()
    run = FlexRun(peer.moving, step, worlds, scene.horizon)
    run.step()
    row = Row(f"mujoco {mujoco.__version__}", scene.name, worlds, step, compile_s=time.perf_counter() - begin)
    row.bytes_per_world = run.bytes_per_world()
    row.error, moves = _error_at_rest(scene.name)
    run.restart()

    def examine() -> Health:
        problems = [] if np.isfinite(run.now).all() else ["a state is not finite"]
        if moves > STILL:
            problems.append(f"not at rest where its error is told: {moves:.2g} m/s")
        return Health(tuple(problems), 0.0, 0.0, 0.0, 0.0)

    time_and_judge(row, run, worlds * run.steps_per_call, seconds, examine)
    row.residual = row.position_error = row.energy_gain = row.penetration = None
    return row


class FlexRun(Rollout):
    """A flex in MuJoCo, from rest in every world."""

    def __init__(self, text: str, dt: float, worlds: int, horizon: float) -> None:
        import mujoco

        model: Any = mujoco.MjModel.from_xml_string(text)
        everything = mujoco.mjtState.mjSTATE_FULLPHYSICS
        start = np.zeros(mujoco.mj_stateSize(model, everything))
        mujoco.mj_getState(model, mujoco.MjData(model), start, everything)
        super().__init__(text, dt, np.tile(start, (worlds, 1)), max(1, round(horizon / dt)), CALL_STEPS)
        self.parts = [np.zeros((worlds, 1, 0))]


@functools.lru_cache(maxsize=8)
def _error_at_rest(name: str) -> tuple[float, float]:
    """Error of the damped flex, and the largest speed that is left [m/s]."""
    import mujoco

    peer = PEERS[name]()
    model: Any = mujoco.MjModel.from_xml_string(peer.resting)
    model.opt.timestep = 1e-3
    data: Any = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    start = data.flexvert_xpos.copy()
    mujoco.mj_step(model, data, nstep=REST)
    mujoco.mj_forward(model, data)
    return peer.error(start, data.flexvert_xpos.copy()), float(np.abs(data.qvel).max())


def _text(**parts: Any) -> str:
    usual: dict[str, Any] = {"floor": "", "pin": "", "sheet": "", "edge": "", "contact": "", "damping": 0.0}
    return _XML.format(**(usual | parts), gravity=GRAVITY, integrator=INTEGRATOR)


def _rod(*, floor: bool = False) -> FlexiblePeer:
    """A rod of as many edges, clamped or falling level."""
    material, numbers, length = scenes.ROD_MATERIAL, scenes.ROD_SECTION.numbers, scenes.ROD_LENGTH
    edge = length / (CELLS + 0.5)
    loose = length / CELLS
    parts: dict[str, Any] = {
        "dim": 1, "radius": numbers.reach_z, "young": material.young, "poisson": material.poisson,
        "edge": '<edge equality="true"/>',
    }  # fmt: skip
    clamped = parts | {
        "count": f"{CELLS + 2} 1 1", "spacing": edge, "pin": '<pin id="0 1"/>', "contact": _NO_CONTACT,
        "mass": material.density * numbers.area * edge * (CELLS + 2), "place": f"{0.5 * CELLS * edge} 0 0",
    }  # fmt: skip
    falling = parts | {
        "count": f"{CELLS + 1} 1 1", "spacing": loose, "place": "0 0 0.2", "floor": _FLOOR.format(friction=0.5),
        "mass": material.density * numbers.area * length,
    }  # fmt: skip

    def error(start: Array, rest: Array) -> float:
        load = material.density * numbers.area * edge * GRAVITY
        along = edge * (np.arange(1, CELLS + 1) + 0.5)
        sag = load * (along**2 * (3.0 * length - along)).sum() / (6.0 * material.young * numbers.inertia_y)
        return float(abs((start[-1, 2] - rest[-1, 2]) / sag - 1.0))

    return FlexiblePeer(_text(**(falling if floor else clamped)), _text(**clamped | {"damping": 0.02}), error)


def _block() -> FlexiblePeer:
    """A block of as many tetrahedra's nodes, falling on a floor or lying on one without friction."""
    material, side, cells = scenes.BLOCK_MATERIAL, scenes.BLOCK_SIZE, 4
    spacing = side / cells
    parts: dict[str, Any] = {
        "dim": 3, "count": "5 5 5", "spacing": spacing, "radius": 0.02 * spacing, "young": material.young,
        "poisson": material.poisson, "mass": material.density * side**3,
    }  # fmt: skip

    def error(_: Array, rest: Array) -> float:
        height = rest.reshape(5, 5, 5, 3)[..., 2]
        sag = material.density * GRAVITY * side**2 / (2.0 * material.young)
        return float(abs((side - (height[..., -1].mean() - height[..., 0].mean())) / sag - 1.0))

    moving = parts | {"place": "0 0 0.1", "damping": material.damping_time, "floor": _FLOOR.format(friction=0.6)}
    resting = parts | {
        "place": f"0 0 {0.5 * side + 0.02 * spacing}", "damping": 0.05, "contact": 'condim="1"',
        "floor": '<geom type="plane" size="50 50 1" condim="1"/>',
    }  # fmt: skip
    return FlexiblePeer(_text(**moving), _text(**resting), error)


def _tarp() -> FlexiblePeer:
    """A tarp on a box, and a plate of as many cells that is held at its edges under its weight."""
    cells, thickness = 10, 0.01
    tarp: dict[str, Any] = {
        "dim": 2, "count": f"{cells + 1} {cells + 1} 1", "spacing": 1.0 / cells, "radius": 0.01, "young": 1e7,
        "poisson": 0.3, "mass": 1.0, "place": "0 0 0.35", "damping": 1e-3, "sheet": 'thickness="1e-3" elastic2d="both"',
        "floor": _FLOOR.format(friction=0.6)
        + '<geom type="box" size=".25 .25 .15" pos="0 0 .15" friction=".6 0 0"/>',
    }  # fmt: skip
    young, density = 2.1e11, 7850.0
    sides = " ".join(str(11 * x + y) for x in range(11) for y in range(11) if {x, y} & {0, 10})
    plate = tarp | {
        "floor": "", "young": young, "damping": 0.02, "mass": density * thickness, "contact": _NO_CONTACT,
        "sheet": f'thickness="{thickness}" elastic2d="both"', "pin": f'<pin id="{sides}"/>',
    }  # fmt: skip

    def error(start: Array, rest: Array) -> float:
        # the weight of a vertex for each cell, which is a little less than a cell's
        load = density * thickness * GRAVITY * cells**2 / (cells + 1) ** 2
        stiffness = young * thickness**3 / (12.0 * (1.0 - 0.3**2))
        return float(abs((start - rest)[:, 2].max() / (0.00406235 * load / stiffness) - 1.0))

    return FlexiblePeer(_text(**tarp), _text(**plate), error)


PEERS: Final[dict[str, Callable[[], FlexiblePeer]]] = {
    "rod": _rod, "rod-on-floor": functools.partial(_rod, floor=True), "tetra": _block, "shell": _tarp,
}  # fmt: skip
"""Scenes that MuJoCo has."""

FLEXIBLE_SCENES: Final = (*PEERS, "hexa", "tire")
"""Scenes with flexible bodies."""
