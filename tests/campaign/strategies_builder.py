"""Calls of the builder: every public method, every argument with what it cannot mean; then the model is stepped."""

import dataclasses
import functools
import inspect
import typing
from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import strategies as st

import simwarp as sw
from tests.campaign.hostile import (
    ACCEPT,
    EITHER,
    NO_NUMBERS,
    REFUSE,
    Value,
    either,
    no_integers,
    no_numbers,
    number_values,
    odd_texts,
    refused,
    shorten,
    vector_values,
)
from tests.campaign.oracle import CallAttack

TETRAHEDRON = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
FACES = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)

CALLS: dict[str, dict[str, Any]] = {
    "add_body": {
        "name": "c",
        "mass": 1.0,
        "inertia": (1.0, 1.0, 1.0),
        "velocity": X,
        "omega": Z,
        "pose": sw.pose((3, 0, 0)),
    },
    "add_shaft": {"name": "c", "inertia": 1.0, "position": 0.1, "speed": 1.0},
    "add_joint_fixed": {"name": "c", "parent": 0, "child": 1, "anchor": X},
    "add_joint_revolute": {"name": "c", "parent": 0, "child": 1, "axis": Z, "anchor": X},
    "add_joint_prismatic": {"name": "c", "parent": 0, "child": 1, "axis": Z, "anchor": X},
    "add_joint_spherical": {"name": "c", "parent": 0, "child": 1, "anchor": X, "dofs": [sw.Dof()] * 3},
    "add_joint_cylindrical": {"name": "c", "parent": 0, "child": 1, "axis": Z, "anchor": X, "dofs": [sw.Dof()] * 2},
    "add_joint_universal": {"name": "c", "parent": 0, "child": 1, "anchor": X, "axis0": X, "axis1": Y, "dofs": []},
    "add_joint_planar": {
        "name": "c",
        "parent": 0,
        "child": 1,
        "normal": Z,
        "direction": Y,
        "anchor": X,
        "dofs": [],
    },
    "add_joint_free": {"name": "c", "child": 1, "anchor": X},
    "add_joint_point_on_plane": {"name": "c", "parent": 0, "child": 1, "anchor": X, "normal": Z},
    "add_joint_point_on_line": {"name": "c", "parent": 0, "child": 1, "anchor": X, "axis": Z},
    "add_joint_parallel": {"name": "c", "parent": 0, "child": 1, "axis": Z},
    "add_joint_perpendicular": {"name": "c", "parent": 0, "child": 1, "axis0": X, "axis1": Y},
    "add_joint_oldham": {"name": "c", "parent": 0, "child": 1, "anchor": X, "normal": Z},
    "add_joint_distance": {"name": "c", "parent": 0, "child": 1, "anchor0": X, "anchor1": Y, "length": 1.0},
    "add_joint_revolute_spherical": {"name": "c", "parent": 0, "child": 1, "anchor0": X, "axis": Z, "anchor1": Y},
    "add_joint_revolute_translational": {
        "name": "c",
        "parent": 0,
        "child": 1,
        "anchor0": X,
        "axis": Z,
        "anchor1": Y,
        "direction": X,
    },
    "add_spring": {"name": "c", "parent": 0, "child": 1, "anchor0": X, "anchor1": Y, "stiffness": 10.0, "damping": 1.0},
    "add_bushing": {
        "name": "c",
        "parent": 0,
        "child": 1,
        "anchor": X,
        "rotation": (0.0, 0.0, 0.0, 1.0),
        "stiffness": (10.0,) * 6,
        "damping": (1.0,) * 6,
    },
    "add_joint_elastic": {
        "name": "c",
        "parent": 0,
        "child": 1,
        "anchor0": X,
        "anchor1": Y,
        "up": Z,
        "stiffness": (10.0,) * 6,
        "damping": (1.0,) * 6,
    },
    "add_rod": {
        "name": "c",
        "points": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.5, 0.0]],
        "section": sw.flex.Round(diameter=0.1),
        "material": sw.flex.Elastic(young=1e6, density=1000.0),
        "twist": 0.1,
        "elements": 3,
        "start": sw.flex.Clamp(0),
    },
    "add_solid_mesh": {
        "name": "c",
        "mesh": sw.flex.box((0.2, 0.1, 0.1), (2, 1, 1)),
        "material": sw.flex.Rubber(young=1e6, density=1000.0),
        "glue": {"a": "x_min"},
        "fixed": "x_max",
        "radius": 0.01,
        "surface": sw.Material(),
        "velocity": X,
        "omega": Z,
        "double": True,
    },
    "add_shell": {
        "name": "c",
        "vertices": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
        "triangles": [[0, 1, 2], [0, 2, 3]],
        "thickness": 0.01,
        "material": sw.flex.Elastic(young=1e6, density=1000.0),
        "pressure": 10.0,
        "fixed": [0],
        "glue": {1: [1]},
        "contact": "faces",
    },
    "add_joint_relative_rotation": {"name": "c", "parent": 0, "child": 1, "axis": Z},
    "add_massless_body": {"name": "c"},
    "add_loop_joint": {"name": "c", "parent": 0, "child": 1, "kind": sw.JointType.FIXED, "frame0": sw.pose()},
    "add_combination": {"name": "c", "terms": [(0, 1.0), (1, -1.0)]},
    "add_coupling": {"name": "c", "terms": [(0, 1.0), (1, -1.0)], "offset": 0.0, "damping": 0.0},
    "add_gear": {"name": "c", "joint0": 0, "joint1": 1, "ratio": 2.0},
    "add_rack": {"name": "c", "pinion": 0, "rack": 1, "radius": 0.1},
    "add_screw": {"name": "c", "cylindrical": 2, "lead": 0.1},
    "add_shape_plane": {"body": -1, "name": "c"},
    "add_shape_sphere": {"body": 0, "radius": 0.5, "name": "c"},
    "add_shape_capsule": {"body": 0, "radius": 0.5, "half_length": 0.5},
    "add_shape_cylinder": {"body": 0, "radius": 0.5, "half_length": 0.5},
    "add_shape_box": {"body": 0, "half": (0.5, 0.5, 0.5)},
    "add_shape_ellipsoid": {"body": 0, "half": (0.5, 0.5, 0.5)},
    "add_shape_cone": {"body": 0, "radius": 0.5, "half_length": 0.5},
    "add_shape_sprocket": {
        "body": 0,
        "arc_center_radius": 0.3,
        "arc_radius": 0.089,
        "tip_radius": 0.26,
        "teeth": 10,
        "half_width": 0.1,
    },
    "add_shape_groove": {"body": 0, "radius": 0.5, "half_width": 0.1},
    "add_shape_primitive": {"body": 0, "kind": "cone", "size": (0.5, 0.5, 0.5)},
    "add_shape_hull": {"body": 0, "points": TETRAHEDRON, "scale": (1.0, 1.0, 1.0)},
    "add_shape_height_field": {"body": -1, "heights": [[0.0, 0.0], [0.0, 0.0]], "size": (4.0, 4.0)},
    "add_shape_mesh": {"body": -1, "vertices": TETRAHEDRON, "triangles": FACES},
    "add_hull_asset": {"points": TETRAHEDRON},
    "add_height_field_asset": {"heights": [[0.0, 0.0], [0.0, 0.0]], "size": (4.0, 4.0)},
    "add_mesh_asset": {"vertices": TETRAHEDRON, "triangles": FACES},
    "add_solid": {"name": "c", "kind": "box", "size": (0.5, 0.5, 0.5), "density": 100.0, "velocity": X},
    "exclude_collision": {"body0": 0, "body1": 1},
    "exclude_shapes": {"shape0": 0, "shape1": 1},
    "add_shape_pair": {"shape0": 0, "shape1": 1},
    "finalize": {"world_count": 1, "device": "cpu", "per_world": ("body_mass",), "contact_capacity": 20},
}
"""A good call of each method; test_quick.py holds that none is missing."""

DOF_FIELDS = [each.name for each in dataclasses.fields(sw.Dof) if each.default == 0.0]
MATERIAL_FIELDS = [field.name for field in dataclasses.fields(sw.Material)]
INDICES = {
    "body", "body0", "body1", "shape0", "shape1", "parent", "child", "joint0", "joint1", "pinion", "rack",
    "cylindrical",
}  # fmt: skip
COUPLINGS = {"add_gear", "add_rack", "add_screw", "add_coupling", "add_combination"}
DIRECTIONS = {"axis", "axis0", "axis1", "normal", "direction"}


def public_methods() -> list[str]:
    """What the builder offers to its users, but properties and look-ups."""
    names = [name for name, _ in inspect.getmembers(sw.ModelBuilder, inspect.isfunction)]
    return [name for name in names if name.startswith(("add_", "exclude_")) or name == "finalize"]


def builder() -> sw.ModelBuilder:
    """Two bodies; shafts and joints that couplings may name."""
    made = sw.ModelBuilder()
    made.add_body("a", mass=1.0, inertia=(1.0, 1.0, 1.0))
    made.add_body("b", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((1, 0, 0)))
    return made


def prepared(method: str) -> sw.ModelBuilder:
    """A builder on which the good call of a method works."""
    made = builder()
    if method in ("add_coupling", "add_combination", "add_gear"):
        made.add_shaft("s0", inertia=1.0), made.add_shaft("s1", inertia=1.0)
    if method in ("exclude_shapes", "add_shape_pair"):
        made.add_shape_sphere(0, radius=0.5), made.add_shape_sphere(1, radius=0.5)
    if method in ("add_rack", "add_screw"):
        made.add_shaft("s0", inertia=1.0)
        made.add_joint_prismatic("p", sw.WORLD, 0, axis=X)
        made.add_joint_cylindrical("y", sw.WORLD, 1, axis=X)
    return made


def values_for(method: str, name: str, good: Any) -> st.SearchStrategy[Value]:
    """Hostile values of an argument, by what it means."""
    if name == "name":
        empty = either("", None) if "shape" in method else refused("", None)  # shapes name themselves
        return st.one_of(
            st.sampled_from([*empty, *refused(3, [], {}, 1.5, True)]), odd_texts.map(lambda text: Value(text, EITHER))
        )
    if name == "inertia" and method == "add_body":
        wrong = [(1.0, 1.0, 10.0), [[1.0, 2.0, 3.0]] * 3, (0.0, 0.0, 0.0), (-1.0, 1.0, 1.0)]
        return st.one_of(vector_values(3), st.sampled_from(refused(*wrong)))
    if isinstance(good, tuple) and name not in ("per_world", "inertia"):
        zero = refused((0.0,) * len(good)) if name in DIRECTIONS or name in ("half", "rotation") else []
        vectors = vector_values(len(good)).filter(lambda value: not (value.value is None and name in ("anchor", "up")))
        return st.one_of(vectors, st.sampled_from(zero)) if zero else vectors
    if name in INDICES:
        return st.one_of(
            no_integers, st.sampled_from([*refused(-2, 7, 10**9, -(10**9), True, None), *either(-1, 0, 1)])
        )
    if name in ("points", "heights", "vertices", "triangles"):
        return st.sampled_from(_tables(good))
    if name == "world_count":
        return st.one_of(no_integers, st.sampled_from(refused(0, -1, True, 10**15, 2**63, 2**33 * 10**4)))
    if name in ("contact_capacity", "elements"):
        return st.one_of(
            no_integers.filter(lambda value: value.value is not None), st.sampled_from(refused(0, -1, True, 10**15))
        )
    if name == "start":
        return st.sampled_from(
            refused("x", 3, [], {}, sw.flex.Clamp("no"), sw.flex.Hinge(99), sw.flex.Hinge(0, axis=3))  # type: ignore[arg-type]
        )
    return _others(name, good)


def _others(name: str, good: Any) -> st.SearchStrategy[Value]:
    lists = {
        "device": refused("gpu", "", "cuda:99", 3, "cpu:7", [], "a\nb"),
        "per_world": refused("body_mass", ("no_such",), (3,), 3, (None,), [[]]),
        "dofs": refused(3, "x", [sw.Dof()] * 9, [3], [None], {}, [sw.Dof(stiffness=float("nan"))] * 3),
        "terms": refused(
            None,
            3,
            "x",
            [],
            [(0,)],
            [(0, 0.0)],
            [(0, float("nan"))],
            [(99, 1.0)],
            [(0, 1e39)],
            [(0, 5, 1.0)],
            [("x", 1.0)],
            [(0, "x")],
            [(0, 10**400)],
            [(0, 1.0)] * 13,
            [3],
        ),
        "pose": refused(3, "x", (0, 0, 0), [1], object(), {}),
        "glue": refused(3, "x", [1], {"no": [0]}, {99: [0]}, {-1: [0]}, {0: [99]}, {0: "no"}, {0: [0.5]}),
        "fixed": refused(3, "no", [99], [-1], [0.5], object(), [[0]], range(100)) + either([], ()),
        "surface": refused(3, "x", [], object(), sw.Material(friction=float("nan"))),
        "double": refused(None, 1, "yes", [], object()),
        "kind": refused("", "ball", 3, None, [], {}),
    }
    if name in lists:
        return st.sampled_from(lists[name])
    if isinstance(good, float):
        optional = name in ("offset", "length")
        return number_values.filter(lambda value: not (optional and value.value is None))
    return st.sampled_from([value for value in NO_NUMBERS if value.value != good])


def _tables(good: list) -> list[Value]:
    """Arrays that are no points, heights or triangles."""
    spoiled = [[*good[:-1], [value, *good[-1][1:]]] for value in (float("nan"), float("inf"), 1e39, 10**400, "x", None)]
    wrong = refused(None, 3, "x", [], [[]], {}, [[1.0]], [good], *spoiled, [good[0], good[0][:1]])
    return wrong + either(good * 2, good[:1])


def _finite_or_flagged(simulation: sw.Simulation) -> None:
    """A world that is not finite is marked as such: nobody reads numbers from it unwarned."""
    finite = all(
        np.isfinite(array.numpy()).all()
        for array in (simulation.state.joint_q, simulation.state.body_v, simulation.state.body_q)
    )
    assert finite or (simulation.state.world_status.numpy() != 0).all(), "not finite, and no world says so"


def step(made: sw.ModelBuilder) -> None:
    """Two steps of what was built."""
    simulation = sw.Simulation(made.finalize(2, "cpu"), 0.01)
    simulation.step()
    simulation.step()
    simulation.problems()
    _finite_or_flagged(simulation)


def _call(method: str, arguments: dict[str, Any]) -> Callable[[], None]:
    def call() -> None:
        made = prepared(method)
        result = getattr(made, method)(**arguments)
        if method == "add_massless_body":  # which must hang on a joint and carry a body
            made.add_joint_revolute("upper", sw.WORLD, result, axis=X)
            made.add_joint_revolute("lower", result, 0, axis=Y)
        if method != "finalize":
            step(made)

    return call


@st.composite
def method_calls(draw: st.DrawFn) -> CallAttack:
    """One argument of a good call gone wrong; an option of Dof or Material among them; rarely none."""
    method = draw(st.sampled_from(sorted(CALLS)))
    good = CALLS[method]
    if draw(st.integers(0, 19)) == 0:
        return CallAttack(f"{method}({_words(good)})", ACCEPT, (), _call(method, good))
    options = _options_of(method)
    name = draw(st.sampled_from([*good, *options, "no_such_argument"]))
    if name == "no_such_argument":
        value, verdict = 1.0, REFUSE
    elif name in options:
        value, verdict = draw(number_values)
    else:
        value, verdict = draw(values_for(method, name, good[name]))
    arguments = good | {name: value}
    own = ("size",) if "shape" in method else ("coefficient",) if method in COUPLINGS else ()
    names = (name, method.removeprefix("add_").removesuffix("_asset"), *own, str(arguments.get("name", "")))
    return CallAttack(f"{method}({_words(arguments)})", verdict, names, _call(method, arguments))


def _options_of(method: str) -> list[str]:
    with_options = ("add_shaft", "add_joint_revolute", "add_joint_prismatic", "add_spring", "add_combination")
    return DOF_FIELDS if method in with_options else []


def _words(arguments: dict[str, Any]) -> str:
    return ", ".join(f"{name}={shorten(value, 60)}" for name, value in arguments.items())


# ---- options of the solver, arguments of a simulation, materials ----------------------------------------------------


@functools.cache
def solver_fields() -> dict[str, Any]:
    """Field -> type hint, of every option of the solver: new ones are attacked by themselves."""
    return typing.get_type_hints(sw.SolverOptions)


def _contact_scene() -> sw.Model:
    made = sw.ModelBuilder()
    made.add_shape_plane(sw.WORLD)
    for index, mass in enumerate((1.0, 1000.0)):
        pose = sw.pose((0.0, 0.0, 0.5 + index))
        made.add_body(f"box{index}", mass=mass, inertia=(mass / 6,) * 3, pose=pose)
        made.add_shape_box(index, half=(0.5, 0.5, 0.5))
    return made.finalize(2, "cpu")


def _solve(**options: Any) -> Callable[[], None]:
    def call() -> None:
        simulation = sw.Simulation(_contact_scene(), 0.005, solver=sw.SolverOptions(**options))
        for _ in range(3):
            simulation.step()
        _finite_or_flagged(simulation)
        height = simulation.state.body_x.numpy()[:, 0, 2]
        assert (height > 0.3).all(), f"a box fell through the floor, to {height.min():.3g} m"

    return call


def _solver_values(name: str, hint: Any) -> st.SearchStrategy[Value]:
    kinds = typing.get_args(hint) or (hint,)
    optional = type(None) in kinds
    if str in kinds:
        return st.one_of(
            odd_texts.map(lambda text: Value(text, REFUSE)), st.sampled_from(refused(3, None, 1.5, True, []))
        )
    if bool in kinds:
        wrong = refused("x", "false", 1.5, float("nan"), [], 2, *([] if optional else [None]))
        return st.sampled_from([*wrong, *either(True, False)])
    if int in kinds:
        no_count = no_integers.filter(lambda value: value.value is not None or not optional)
        return st.one_of(
            no_count, st.sampled_from(refused(-1, -(2**31), 2**33, 2**63, True)), st.sampled_from(either(0, 1, 2))
        )
    return st.one_of(no_numbers, st.sampled_from([*refused(-1.0, -1e-3, None), *either(0.0, 1e-30, 1e-3, 1.0)]))


@st.composite
def solver_calls(draw: st.DrawFn) -> CallAttack:
    """Options of the solver, one hostile, one more chosen at random: they act together."""
    name = draw(st.sampled_from(sorted(solver_fields())))
    value, verdict = draw(_solver_values(name, solver_fields()[name]))
    options = {
        "solver": draw(st.sampled_from(("apgd", "psor", "spg", "padmm", "interior_point"))),
        "fallback": draw(st.sampled_from((None, True, False))),
        "dense_rows": draw(st.sampled_from((0, 5, 128))),
        "friction_law": draw(st.sampled_from(("exact", "convex"))),
        "max_iterations": 20,
        name: value,
    }
    return CallAttack(f"SolverOptions({_words(options)})", verdict, (name,), _solve(**options))


def _simulate(**arguments: Any) -> Callable[[], None]:
    def call() -> None:
        simulation = sw.Simulation(_small_model(), **arguments)
        simulation.step()
        _finite_or_flagged(simulation)

    return call


def _small_model() -> sw.Model:
    made = builder()
    made.add_joint_revolute("hinge", sw.WORLD, 0, axis=Y)
    return made.finalize(2, "cpu", per_world=("body_mass",))


@st.composite
def simulation_calls(draw: st.DrawFn) -> CallAttack:
    """Arguments of Simulation; materials; the builder's gravity; poses."""
    kind = draw(st.sampled_from(("dt", "substeps", "read_every", "material", "gravity", "pose", "solver")))
    value, verdict = draw(number_values)
    if kind == "dt":
        wrong = draw(st.sampled_from([Value(value, verdict), *refused(0.0, -1.0, None, True, "x")]))
        return CallAttack(f"Simulation(dt={shorten(wrong.value)})", wrong.verdict, ("dt",), _simulate(dt=wrong.value))
    if kind in ("substeps", "read_every"):
        value, verdict = draw(st.one_of(no_integers, st.sampled_from(refused(0, -1, True, 10**20))))
        call = _simulate(dt=0.01, **{kind: value})
        return CallAttack(f"Simulation({kind}={shorten(value)})", verdict, (kind,), call)
    if kind == "solver":
        value = draw(st.sampled_from(("apgd", 3, {}, [], "x", object)))
        return CallAttack(f"Simulation(solver={value!r})", REFUSE, (kind,), _simulate(dt=0.01, solver=value))
    if kind == "gravity":
        value, verdict = draw(vector_values(3))
        return CallAttack(f"ModelBuilder({shorten(value)})", verdict, (kind,), lambda: _gravity(value))
    if kind == "pose":
        value, verdict = draw(vector_values(3))
        return CallAttack(f"add_body at {shorten(value)}", verdict, (kind, "position"), lambda: _pose(value))
    field = draw(st.sampled_from(MATERIAL_FIELDS))
    return CallAttack(f"Material({field}={shorten(value)})", verdict, (field,), lambda: _material(field, value))


def _gravity(value: Any) -> None:
    made = sw.ModelBuilder(gravity=value)
    made.add_body("a", mass=1.0, inertia=(1.0, 1.0, 1.0))
    step(made)


def _pose(value: Any) -> None:
    made = sw.ModelBuilder()
    made.add_body("a", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose(value))
    step(made)


def _material(field: str, value: Any) -> None:
    made = builder()
    made.add_shape_sphere(0, radius=0.5, material=sw.Material(**{field: value}))
    step(made)


def builder_calls() -> st.SearchStrategy[CallAttack]:
    """Calls of Python around the core, those of builder methods most often."""
    return st.one_of(method_calls(), method_calls(), solver_calls(), simulation_calls())


def warm_up() -> None:
    """Load every kernel that the calls need, where no alarm counts the time."""
    step(builder())
    for solver in ("apgd", "interior_point"):
        _solve(solver=solver)()
