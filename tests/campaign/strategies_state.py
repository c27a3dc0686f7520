"""What is written into a running simulation: joint states, controls, parameters, ranges of randomisation, snapshots."""

import copy
import functools
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from hypothesis import strategies as st

import simwarp as sw
from tests.campaign.hostile import (
    ACCEPT,
    EITHER,
    REFUSE,
    Value,
    either,
    no_integers,
    no_numbers,
    number_values,
    odd_texts,
    refused,
    shorten,
)
from tests.campaign.oracle import CallAttack
from tests.campaign.strategies_builder import _finite_or_flagged, builder

WORLDS, DOFS, BODIES = 2, 2, 2
CONTROLS = (
    "joint_force",
    "joint_target_q",
    "joint_target_qd",
    "body_force",
    "body_torque",
    "body_force_b",
    "body_torque_b",
)
MASSES = {"body_mass", "body_inertia_b"}


@functools.cache
def _simulation() -> sw.Simulation:
    made = builder()
    for index, name in enumerate(("hinge", "slide")):
        add = made.add_joint_revolute if index == 0 else made.add_joint_prismatic
        add(
            name,
            sw.WORLD,
            index,
            axis=(0.0, 1.0, 0.0),
            stiffness=1.0,
            damping=0.1,
            friction=0.1,
            drive=sw.PositionDrive(stiffness=1.0),
        )
        made.add_shape_sphere(index, radius=0.1)
    model = made.finalize(WORLDS, "cpu", per_world=_parameters())
    return sw.Simulation(model, 0.01)


@functools.cache
def _parameters() -> tuple[str, ...]:
    """Names of what may differ from world to world, of the released interface: the model tells unknown ones."""
    from simwarp.model import model

    return tuple(
        sorted(name for name in model.PARAMETERS if not name.startswith(("coupling", "shape_asset", "shape_enabled")))
    )


def _restored(act: Callable[[sw.Simulation], None]) -> Callable[[], None]:
    """Do something with the simulation, step it, and put everything back."""

    def call() -> None:
        simulation = _simulation()
        before = simulation.snapshot()
        kept = {name: wp.clone(getattr(simulation.model, name)) for name in _parameters()}
        try:
            act(simulation)
            simulation.step()
            _finite_or_flagged(simulation)
        finally:
            for name, array in kept.items():
                wp.copy(getattr(simulation.model, name), array)
            simulation.restore(before)

    return call


def _row_values(shape: tuple[int, ...]) -> list[Value]:
    """Arrays for a place of a shape: wrong shapes, wrong types, numbers that are none."""
    good = np.zeros(shape)
    wrong_shapes = [
        np.zeros((shape[0] + 1, *shape[1:])),
        np.zeros((*shape, 5)),
        np.zeros((shape[0], shape[1] + 1, *shape[2:])),
    ]
    hostile = [np.full(shape, value) for value in (np.nan, np.inf, -np.inf, 1e39, 1e308)]
    one = good.copy()
    one.flat[-1] = np.nan
    texts = ["x", [["a"]], {}, object(), [[1.0], [1.0, 2.0]], np.full(shape, "x"), np.full(shape, 1j)]
    return [
        *refused(*wrong_shapes, *hostile, one, *texts),
        Value(good, ACCEPT),
        *either(np.full(shape, 1e30), np.ones(shape)),
    ]


@st.composite
def joint_states(draw: st.DrawFn) -> CallAttack:
    """set_joint_state with a mask, coordinates or rates gone wrong."""
    name = draw(st.sampled_from(("world_mask", "q", "qd")))
    if name == "world_mask":
        masks = [[True], [True] * 3, "x", 3, [0.5, 0.5], [None, None], {}, np.zeros((2, 2), bool), object()]
        value, verdict = draw(st.sampled_from([*refused(*masks), *either([True, False], np.array([1, 0]))]))
    else:
        value, verdict = draw(st.sampled_from(_row_values((WORLDS, DOFS))))
    arguments = {"world_mask": None, "q": None, "qd": None, name: value}
    what = f"set_joint_state({name}={shorten(value)} {np.shape(value) if isinstance(value, np.ndarray) else ''})"
    return CallAttack(
        what, verdict, (name, "mask"), _restored(lambda simulation: simulation.set_joint_state(**arguments))
    )


@st.composite
def writes(draw: st.DrawFn) -> CallAttack:
    """Values assigned to a control or a parameter, whole or in part."""
    is_control = draw(st.booleans())
    name = draw(st.sampled_from(CONTROLS if is_control else _parameters()))
    owner = "control" if is_control else "model"
    array = getattr(getattr(_simulation(), owner), name)
    shape = tuple(array.numpy().shape)
    value, verdict = draw(st.sampled_from(_row_values(shape) if len(shape) > 1 else refused("x", {}, object())))
    if isinstance(value, np.ndarray) and value.shape == shape and value.dtype == float:
        # a broken policy writes NaN into controls, and its world is marked; zero is no mass
        verdict = EITHER if is_control or verdict is not REFUSE else verdict
        if array.dtype in (wp.float64, wp.vec3d, wp.mat33d) and np.isfinite(value).all():
            verdict = EITHER  # it holds 1e39
    by_assign = draw(st.booleans())
    if not isinstance(value, np.ndarray):
        by_assign = False

    def act(simulation: sw.Simulation) -> None:
        target = getattr(getattr(simulation, owner), name)
        if by_assign:
            target.assign(value)
        else:
            target[:] = value

    size = np.shape(value) if isinstance(value, np.ndarray) else ""
    how = f"{owner}.{name}{'.assign' if by_assign else '[:] ='} {shorten(value)} of {size}"
    return CallAttack(how, verdict, (name,), _restored(act))


@st.composite
def ranges(draw: st.DrawFn) -> CallAttack:
    """What a task randomises: a parameter that is none, that cannot act, bounds that are none."""
    from simwarp.tasks import Range, make

    field = draw(st.sampled_from(("low", "high", "mode", "when", "only", "shared", "draw", "grows", "name", "whole")))
    arguments: dict[str, Any] = {"low": 0.9, "high": 1.1}
    name, verdict, value = "body_mass", REFUSE, None
    if field in ("low", "high"):
        value, verdict = draw(no_numbers)
    elif field == "name":
        # what a cart and a pole have no rows of cannot be drawn
        none = ["", "x", "joint_friction", "drive_effort_limit", "drive_stiffness", "shape_friction", "coupling_offset"]
        value = name = draw(st.sampled_from(none) | odd_texts)
    elif field == "whole":
        value = draw(
            st.sampled_from(("x", 3, [], None, [Range(1.0, 2.0)], {"body_mass": 3}, {"body_mass": None}, {3: 4}))
        )
    else:
        value = draw(st.sampled_from((3, 1.5, [3], {}, object(), [None])))
        verdict = EITHER if field in ("shared", "grows") else REFUSE
    if field not in ("name", "whole"):
        arguments[field] = value

    def call() -> None:
        task = make("pendulum", 2, randomise=value if field == "whole" else {name: Range(**arguments)})
        task.restart()

    return CallAttack(f"randomise {name}: {field}={shorten(value)}", verdict, (field, "randomise", "Range", name), call)


@st.composite
def tasks(draw: st.DrawFn) -> CallAttack:
    """Fields of a task's configuration and arguments of make."""
    from simwarp.tasks import make

    whole = ("num_worlds", "seed", "first_world", "substeps", "decimation", "max_episode_steps", "guard_steps")
    name = draw(
        st.sampled_from((*whole, "dt", "gravity", "force_gain", "action_rise_time", "max_angle", "no_such_field"))
    )
    value, verdict = draw(no_integers if name in whole else number_values)
    if name == "action_rise_time" and not isinstance(value, (int, float)):
        verdict = EITHER  # it may be a tuple
    if name == "no_such_field":
        verdict = REFUSE
    call = functools.partial(make, "pendulum", **({"num_worlds": 2} | {name: value}))
    return CallAttack(f"make(pendulum, {name}={shorten(value)})", verdict, (name, name.removeprefix("num_")), call)


@st.composite
def pickles(draw: st.DrawFn) -> CallAttack:
    """Things that hold device memory, pickled or copied: told what to do instead."""
    name = draw(st.sampled_from(("model", "simulation", "snapshot")))
    act = draw(st.sampled_from((pickle.dumps, copy.deepcopy, copy.copy)))

    def call() -> None:
        simulation = _simulation()
        act({"model": simulation.model, "simulation": simulation, "snapshot": simulation.snapshot()}[name])

    verdict = REFUSE if act is pickle.dumps else EITHER
    return CallAttack(f"{act.__name__}({name})", verdict, (name,), call)


def state_calls() -> st.SearchStrategy[CallAttack]:
    """Calls of Python around a running simulation."""
    return st.one_of(joint_states(), writes(), writes(), ranges(), tasks(), pickles())
