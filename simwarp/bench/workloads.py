"""Benchmark workloads: scenes with a motion that is real work, and by name vehicles and tasks."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterable
from typing import Any, Final

from simwarp import scenes
from simwarp.bench.flexible_errors import block_sag_error, plate_error, rod_sag_error, tire_load_error
from simwarp.bench.motion import swinging_drives, swinging_joints, twisted_bodies
from simwarp.cli import shortened
from simwarp.core.types import WORLD, Material, PositionDrive, pose
from simwarp.core.wording import suggestions
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation, SolverOptions
from simwarp.vehicle.spec.vehicle_files import reduced_vehicle_names, vehicle_names

CART_MASS = 0.1
POLE_MASS = 0.785398
POLE_INERTIA = (0.262290, 0.262290, 0.000981748)
RAIL = 2.0
TASK_SUFFIX = "-task"

SENSOR_SCENES: Final = {
    "rays": "closest hits of rays on meshes of 10 k and 200 k triangles, as many rays a world as a camera of 80x45 has",
    "camera": "RGB of 80x45 over hills with 50 rocks, with the sun's shadows",
    "camera-flat": "the same camera over a plane with 50 boxes, balls and cylinders",
    "camera-corridor": "the same camera in a corridor of triangles",
    "lidar": "VLP-16 over hills with 50 rocks",
}
"""Sensors that are measured, and in what."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BenchScene:
    """A scene, its step, the motion it is timed in and what that motion may do.

    Attributes:
        name: on the command line.
        summary: one line.
        build: makes one world.
        dt: step that suits it [s].
        horizon: time after which it starts anew [s].
        start: half-widths of uniform start coordinates, one per degree of freedom; as built where empty.
        force: half-width of constant random joint forces, different in every world [N or N·m]: for all degrees of
            freedom, or one each.
        energy_gain: most that forces, springs and the error of the step may add to the mechanical energy [J]; a tenth
            of what the scene holds where None.
        position_error: largest sound violation of a joint [m or rad]; half h² ω² r is normal.
        start_velocity: half-width of uniform start velocities of bodies, different in every world [m/s].
        motion: makes the recorded launch that writes forces before every step, from a simulation and `variants`.
        settle: time that the motion runs before anything is measured [s].
        variants: worlds that differ; then starts and motions repeat (only where there is a motion or settling).
        solver: its options; `tolerance` is told in the row.
        penetration: largest sound depth of a contact [m].
        error: makes `Row.error` on a device.
    """

    name: str
    summary: str
    build: Callable[[], ModelBuilder]
    dt: float = 1e-3
    horizon: float = 2.0
    start: tuple[float, ...] = ()
    force: float | tuple[float, ...] = 0.0
    energy_gain: float | None = None
    position_error: float = 0.02
    start_velocity: float = 0.0
    motion: Callable[[Simulation, int], Any] | None = None
    settle: float = 0.0
    variants: int = 16
    solver: SolverOptions = dataclasses.field(default_factory=SolverOptions)
    penetration: float = 0.01
    error: Callable[[str | None], float] | None = None


def cart_pole() -> ModelBuilder:
    """The cart-pole of the pendulum task, on a rail with ends: the cart slides along X, the pole turns about Y."""
    builder = ModelBuilder()
    cart = builder.add_body("cart", mass=CART_MASS, inertia=(1.0, 1.0, 1.0))
    pole = builder.add_body("pole", mass=POLE_MASS, inertia=POLE_INERTIA, pose=pose((0.0, 0.0, 1.0)))
    builder.add_joint_prismatic("slide", WORLD, cart, axis=(1.0, 0.0, 0.0), limit=(-RAIL, RAIL))
    builder.add_joint_revolute("hinge", cart, pole, axis=(0.0, 1.0, 0.0), anchor=(0.0, 0.0, 0.0))
    return builder


_CART_POLE = BenchScene(
    name="pendulum", summary="cart-pole of the pendulum task, with the ends of its rail", build=cart_pole, dt=0.01,
    horizon=5.0, start=(0.5, 0.05), force=(0.5, 0.0),
    # The force works at most 0.5 N × 4 m; a step of 10 ms may add a quarter of the 15 J that the pole falls
    energy_gain=6.0,
)  # fmt: skip

_NAMES = {"pendulum": "simple-pendulum"}
"""Scenes of `simwarp.scenes` whose name the contract gives to another one."""


def rough_pile() -> ModelBuilder:
    """216 balls of 10 kg that roll: with friction 0.5 the grid collapses into a heap."""
    return scenes.pile(material=Material(friction=0.5))


def driven_hexapod() -> ModelBuilder:
    """The hexapod with a drive in every joint: links of 0.02 to 0.08 kg are too light for explicit PD torques."""
    return scenes.hexapod(drive=PositionDrive(stiffness=5.0, damping=0.05))


_COARSE = SolverOptions(tolerance=1e-4)
"""A hundredth of a percent of 1 m/s: a tenth of the largest sound residual."""

_SETTINGS: dict[str, dict[str, Any]] = {
    # Its crank turns eight times in 30 ms under 0.033 N·m
    "andrews": {"dt": 1e-5, "horizon": 0.03, "energy_gain": 2.0},
    # At rest and weightless as built; 0.1 N·m over ten turns of a few light bodies
    "floating_tree": {"force": 0.1, "energy_gain": 20.0},
    # 20 N·m spin a wheel up by 2 kJ in 2 s; it starts with 130 kJ
    "linkage": {"force": 20.0, "energy_gain": 12e3},
    # The motor lends and takes: at most ½ 6 kg (4 m/s)²
    "slider_crank": {"energy_gain": 50.0},
    # Eight motors swing legs of 1 kg and lift 10 kg by some centimetres in every period
    "ant": {
        "dt": 5e-3, "motion": swinging_joints, "settle": 1.0, "energy_gain": 10.0,
        "solver": SolverOptions(tolerance=1e-3),
    },
    # 18 drives swing the legs out of step, so that the feet stamp and slide
    "hexapod": {
        "build": driven_hexapod, "dt": 5e-3, "motion": swinging_drives, "settle": 1.0, "energy_gain": 5.0,
        "solver": SolverOptions(tolerance=1e-3),
    },
    # It stands, while the load on its contacts changes all the time
    "stack": {
        "dt": 5e-3, "motion": twisted_bodies, "start_velocity": 0.05, "settle": 0.2, "solver": _COARSE,
        "energy_gain": 1.0,
    },
    # From here on it falls apart
    "pile": {
        "build": rough_pile, "start_velocity": 0.1, "settle": 0.3, "horizon": 0.6, "variants": 2, "solver": _COARSE,
    },
    # Built at rest, in balance
    "arch": {"start_velocity": 0.05, "horizon": 0.5, "solver": _COARSE},
    "card_house": {"start_velocity": 0.05, "horizon": 0.5, "solver": _COARSE},
    "heavy_on_light": {"start_velocity": 0.1, "horizon": 0.5, "solver": _COARSE},
    "rolling_box": {"start_velocity": 0.5, "solver": _COARSE},
    # It swings under its weight, and falls level
    "rod": {"start": (0.0, 0.0, 0.0, 1e-3, 1e-3, 1e-3) * 20, "horizon": 1.0, "error": rod_sag_error},
    "rod_on_floor": {"horizon": 1.0, "error": rod_sag_error},
    # They fall by 5 cm; numerical damping takes what the impact excites
    "tetra": {"horizon": 0.5, "start_velocity": 0.05, "solver": _COARSE, "energy_gain": 0.05,
              "error": functools.partial(block_sag_error, scenes.tetra)},
    "hexa": {"horizon": 0.5, "start_velocity": 0.05, "solver": _COARSE, "energy_gain": 0.05,
             "error": functools.partial(block_sag_error, scenes.hexa)},
    "shell": {"horizon": 0.5, "start_velocity": 0.01, "solver": _COARSE, "energy_gain": 0.05, "error": plate_error},
    # Air presses the tire into its shape: that is work
    "tire": {"horizon": 0.3, "solver": _COARSE, "energy_gain": 2e3, "error": tire_load_error},
    "wall": {"start_velocity": 0.1, "horizon": 0.5, "solver": _COARSE},
}  # fmt: skip


def bench_scenes() -> dict[str, BenchScene]:
    """Every scene by name: the cart-pole, and the builders of `simwarp.scenes`."""
    found = {_CART_POLE.name: _CART_POLE}
    for function, build in inspect.getmembers(scenes, inspect.isfunction):
        if function.startswith("_") or build.__annotations__.get("return") != "ModelBuilder":
            continue
        name = _NAMES.get(function, function.replace("_", "-"))
        summary = (inspect.getdoc(build) or "").partition("\n")[0]
        fields: dict[str, Any] = {"name": name, "summary": summary, "build": build}
        found[name] = BenchScene(**fields | _SETTINGS.get(function, {}))
    return found


ON_SOIL: Final = {"hmmwv-soil": "hmmwv"}
"""Rows of vehicles on mid soil, and the vehicle's own name."""

CONVOYS: Final = {"hmmwv-convoy": "hmmwv"}
"""Rows of several vehicles in each world, and the vehicle's own name."""


def vehicle_row_names() -> list[str]:
    """Names of the rows: vehicles on tires of their own, then reduced ones, on soil, then several in a world."""
    return [*vehicle_names(), *reduced_vehicle_names(), *ON_SOIL, *CONVOYS]


def task_of(name: str, tasks: Iterable[str]) -> str | None:
    """The task that a name means, if it means one: its own name, or with `-task` behind."""
    known = set(tasks)
    bare = name.removesuffix(TASK_SUFFIX)
    return name if name in known else bare if bare in known else None


def display_names(tasks: Iterable[str]) -> list[str]:
    """All names: scenes, vehicles, sensors, and tasks, with `-task` behind where another has the name already."""
    scene_names = [*bench_scenes(), *vehicle_row_names(), *SENSOR_SCENES]
    return scene_names + [task + TASK_SUFFIX if task in scene_names else task for task in sorted(tasks)]


def unknown_name_message(name: str, tasks: Iterable[str]) -> str:
    """One line about a name that is no scene, vehicle or task."""
    known = display_names(tasks)
    hint = suggestions(name, known, f"there are: {', '.join(known)}")
    return f"unknown scene '{shortened(name)}'; {hint}"
