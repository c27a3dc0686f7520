"""Every error of construction names the thing, the rule, the value received and the remedy; what is legal stays so."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import (
    WORLD,
    Dof,
    JointType,
    ModelError,
    Pose,
    PositionDrive,
    PrescribedPosition,
    PrescribedSpeed,
    VelocityMotor,
    pose,
)
from simwarp.model.builder import ModelBuilder
from simwarp.model.joint_types import ELEMENTS

INF, NAN = math.inf, math.nan
THREE: Any = (-1.0, 0.0, 1.0)
BAD_POSE: Any = pose  # for what no type checker lets through


@pytest.fixture
def b() -> ModelBuilder:
    """Two bodies, a hinge (joint 0), a slide (1), a fixed joint (2), a thread (3) and a shaft (4)."""
    builder = ModelBuilder()
    for k, name in enumerate(("a", "b", "c", "d")):
        builder.add_body(name, mass=1.0, inertia=(1, 1, 1), pose=pose((float(k), 0, 0)))
    builder.add_joint_revolute("hinge", WORLD, 0, axis=(0, 0, 1))
    builder.add_joint_prismatic("slide", 0, 1, axis=(0, 0, 1))
    builder.add_joint_fixed("weld", 1, 2)
    builder.add_joint_cylindrical("thread", 2, 3, axis=(0, 0, 1))
    builder.add_shaft("shaft", inertia=1.0)
    return builder


Case = tuple[str, Callable[[Any], object], tuple[str, ...]]


def hinge(**options: Any) -> Callable[[Any], object]:
    return lambda b: b.add_joint_revolute("new", WORLD, 1, **({"axis": (0, 0, 1)} | options))


def body(**options: Any) -> Callable[[Any], object]:
    return lambda b: b.add_body(**({"name": "new", "mass": 1.0, "inertia": (1, 1, 1)} | options))


BODIES: list[Case] = [
    ("zero mass", body(mass=0.0), ("body 'new'", "mass must be positive", "0.0", "WORLD")),
    ("negative mass", body(mass=-1.0), ("body 'new'", "mass", "-1.0")),
    ("infinite mass", body(mass=INF), ("body 'new'", "mass", "inf", "WORLD")),
    ("NaN mass", body(mass=NAN), ("body 'new'", "mass", "nan")),
    ("mass of text", body(mass="heavy"), ("body 'new'", "mass", "'heavy'")),
    ("no mass", body(mass=None), ("body 'new'", "mass", "None")),
    ("empty name", body(name=""), ("body", "name must be a non-empty string", "''", "give it one")),
    ("number as name", body(name=3), ("body", "name must be", "3")),
    ("name taken", body(name="a"), ("body 'a'", "taken", "choose")),
    ("two inertias", body(inertia=(1, 1)), ("body 'new'", "inertia must be three", "(1, 1)", "ixx")),
    ("NaN inertia", body(inertia=(1, NAN, 1)), ("body 'new'", "inertia", "nan")),
    ("inertia of text", body(inertia="solid"), ("body 'new'", "inertia", "'solid'")),
    (
        "skew inertia",
        body(inertia=[[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]),
        ("body 'new'", "symmetric", "0.5", "symmetrise"),
    ),
    ("zero inertia", body(inertia=(0, 1, 1)), ("body 'new'", "positive definite", "0.0", "small")),
    ("indefinite", body(inertia=[[1, 2, 0], [2, 1, 0], [0, 0, 1]]), ("body 'new'", "positive definite", "-1")),
    ("impossible", body(inertia=(1, 1, 3)), ("body 'new'", "a + b >= c", "3.0", "units")),
    ("short velocity", body(velocity=(1, 2)), ("body 'new'", "velocity must be 3 finite", "(1, 2)", "sequence")),
    ("NaN omega", body(omega=(NAN, 0, 0)), ("body 'new'", "omega", "nan")),
    ("pose of numbers", body(pose=(0, 0, 1)), ("body 'new'", "pose must be a Pose", "(0, 0, 1)", "simwarp.pose(")),
    ("broken pose", body(pose=Pose(np.zeros(3), np.zeros(4))), ("rotation", "non-zero length")),
    ("gravity", lambda b: ModelBuilder(gravity=(0, 0)), ("ModelBuilder", "gravity must be 3", "(0, 0)")),
    ("pose position", lambda b: pose((0, 0, INF)), ("pose", "position must be 3 finite", "inf")),
    ("pose of text", lambda b: BAD_POSE("here"), ("pose", "position", "'here'")),
    ("pose rotation", lambda b: pose(rotation=(0, 0, 0, 0)), ("pose", "rotation", "zeros", "(0, 0, 0, 1)")),
]
SHAFTS: list[Case] = [
    ("zero", lambda b: b.add_shaft("s", inertia=0.0), ("shaft 's'", "inertia must be positive", "0.0")),
    ("position", lambda b: b.add_shaft("s", inertia=1.0, position=NAN), ("shaft 's'", "position", "nan")),
    ("speed", lambda b: b.add_shaft("s", inertia=1.0, speed=INF), ("shaft 's'", "speed", "inf")),
    ("option", lambda b: b.add_shaft("s", inertia=1.0, fricton=1.0), ("shaft 's'", "fricton", "'friction'")),
]
JOINTS: list[Case] = [
    ("no such parent", lambda b: b.add_joint_fixed("new", 9, 1), ("joint 'new'", "parent", "0..3", "9", "add_body")),
    ("no such child", lambda b: b.add_joint_fixed("new", 0, -2), ("joint 'new'", "child", "-2", "add_body")),
    ("child is text", lambda b: b.add_joint_fixed("new", 0, "b"), ("joint 'new'", "child", "'b'")),
    ("child is bool", lambda b: b.add_joint_fixed("new", 0, True), ("joint 'new'", "child", "True")),
    ("same twice", lambda b: b.add_joint_fixed("new", 1, 1), ("joint 'new'", "differ", "1", "two bodies")),
    ("world twice", lambda b: b.add_joint_fixed("new", WORLD, WORLD), ("joint 'new'", "differ", "-1")),
    ("name taken", lambda b: b.add_joint_fixed("hinge", 0, 1), ("joint 'hinge'", "taken", "choose")),
    ("zero axis", hinge(axis=(0, 0, 0)), ("joint 'new'", "axis must have a length", "zeros", "direction")),
    ("NaN axis", hinge(axis=(0, NAN, 0)), ("joint 'new'", "axis", "nan")),
    ("short axis", hinge(axis=(0, 1)), ("joint 'new'", "axis must be 3", "(0, 1)")),
    ("anchor", hinge(anchor=(0, 1)), ("joint 'new'", "anchor must be 3", "(0, 1)")),
    ("unknown option", hinge(stifness=1.0), ("joint 'new'", "stifness", "did you mean 'stiffness'")),
    ("strange option", hinge(zzz=1.0), ("joint 'new'", "zzz", "known: limit, armature")),
    (
        "cardan axes",
        lambda b: b.add_joint_universal("new", 0, 1, anchor=(0, 0, 0), axis0=(1, 0, 0), axis1=(1, 1, 0)),
        ("joint 'new'", "perpendicular", "0.707"),
    ),
    (
        "perpendicular",
        lambda b: b.add_joint_perpendicular("new", 0, 1, axis0=(1, 0, 0), axis1=(1, 0, 0)),
        ("joint 'new'", "perpendicular", "1"),
    ),
    (
        "rod of no length",
        lambda b: b.add_joint_distance("new", 0, 1, anchor0=(0, 0, 0), anchor1=(0, 0, 0)),
        ("joint 'new'", "apart", "0.0", "move one"),
    ),
    (
        "length of zero",
        lambda b: b.add_joint_distance("new", 0, 1, anchor0=(0, 0, 0), anchor1=(1, 0, 0), length=0.0),
        ("joint 'new'", "length must be positive", "0.0", "add_joint_spherical"),
    ),
    (
        "infinite length",
        lambda b: b.add_joint_distance("new", 0, 1, anchor0=(0, 0, 0), anchor1=(1, 0, 0), length=INF),
        ("joint 'new'", "length", "inf"),
    ),
    (
        "both",
        lambda b: b.add_joint_distance("new", 0, 1, anchor0=(0, 0, 0), anchor1=(1, 0, 0), length=1.0, limit=(0, 1)),
        ("joint 'new'", "both", "drop one"),
    ),
    (
        "spring of no length",
        lambda b: b.add_spring("new", 0, 1, anchor0=(0, 0, 0), anchor1=(0, 0, 0), stiffness=1.0),
        ("spring 'new'", "apart", "0.0"),
    ),
    (
        "bushing stiffness",
        lambda b: b.add_bushing("new", 0, 1, anchor=(0, 0, 0), stiffness=(1, 2, 3)),
        ("bushing 'new'", "stiffness must be 6", "(1, 2, 3)"),
    ),
    (
        "soft bushing",
        lambda b: b.add_bushing("new", 0, 1, anchor=(0, 0, 0), stiffness=(1, 1, 1, 1, 1, -1)),
        ("new", "stiffness", "-1.0", "0 for none"),
    ),
    (
        "link along its axis",
        lambda b: b.add_joint_revolute_spherical("new", 0, 1, anchor0=(0, 0, 0), axis=(0, 0, 1), anchor1=(1, 0, 0.1)),
        ("joint 'new'", "anchor1 - anchor0 must be perpendicular to axis", "0.1 m", "move anchor0"),
    ),
    (
        "slider along its axis",
        lambda b: b.add_joint_revolute_translational(
            "new", 0, 1, anchor0=(0, 0, 0), axis=(0, 0, 1), anchor1=(1, 0, -0.2), direction=(1, 0, 0)
        ),
        ("joint 'new'", "anchor1 - anchor0 must be perpendicular to axis", "-0.2 m", "move anchor0"),
    ),
    (
        "slider direction",
        lambda b: b.add_joint_revolute_translational(
            "new", 0, 1, anchor0=(0, 0, 0), axis=(0, 0, 1), anchor1=(1, 0, 0), direction=(1, 0, 1)
        ),
        ("joint 'new'", "axis and direction must be perpendicular", "0.707", "take the component"),
    ),
    (
        "slider of zeros",
        lambda b: b.add_joint_revolute_translational(
            "new", 0, 1, anchor0=(0, 0, 0), axis=(0, 0, 1), anchor1=(1, 0, 0), direction=(0, 0, 0)
        ),
        ("joint 'new'", "direction must have a length"),
    ),
    (
        "two dofs for three",
        lambda b: b.add_joint_spherical("new", 0, 1, anchor=(0, 0, 0), dofs=[Dof(), Dof()]),
        ("joint 'new'", "dofs must have 3 entries", "SPHERICAL", "got 2", "Dof()"),
    ),
    (
        "one dof for two",
        lambda b: b.add_joint_cylindrical("new", 0, 1, axis=(1, 0, 0), dofs=Dof()),
        ("joint 'new'", "dofs must be a sequence", "Dof(", "dofs=["),
    ),
    (
        "dof of a dict",
        lambda b: b.add_joint_cylindrical("new", 0, 1, axis=(1, 0, 0), dofs=[{}, {}]),
        ("joint 'new'", "must be a Dof", "{}", "Dof("),
    ),
]


def floating(b: ModelBuilder, *names: str) -> None:
    """More bodies, tied to nothing: 4, 5 ..."""
    for name in names:
        b.add_body(name, mass=1.0, inertia=(1, 1, 1))


def free_twice(b: ModelBuilder) -> None:
    floating(b, "e")
    b.add_joint_free("f", 4)
    b.add_joint_free("g", 4)


def free_twice_in_a_tree(b: ModelBuilder) -> None:
    floating(b, "e", "f")
    b.add_joint_free("free", 4)
    b.add_joint_fixed("tie", 4, 5)
    b.add_joint_free("g", 5)


def free_with_a_bad_anchor(b: ModelBuilder) -> None:
    floating(b, "e")
    b.add_joint_free("f", 4, anchor=(0, NAN, 0))


FREE: list[Case] = [
    ("the world", lambda b: b.add_joint_free("new", WORLD), ("joint 'new'", "child", "-1", "add_body")),
    ("no such body", lambda b: b.add_joint_free("new", 7), ("joint 'new'", "child", "7")),
    ("tied", lambda b: b.add_joint_free("new", 0), ("joint 'new'", "body 'a' must float", "'hinge'", "leave this")),
    ("tied by others", lambda b: b.add_joint_free("new", 3), ("joint 'new'", "body 'd' must float", "'hinge'")),
    ("twice", free_twice, ("joint 'g'", "no other FREE joint", "'f'", "leave this one out")),
    ("twice in a tree", free_twice_in_a_tree, ("joint 'g'", "no other FREE joint", "'free'")),
    ("anchor", free_with_a_bad_anchor, ("joint 'f'", "anchor", "nan")),
]
TABLE = ((0.0, 1.0), (0.0, 1.0))
NOT_NEGATIVE = [each.name for each in fields(Dof) if each.default == 0.0 and each.name not in ("preload", "rest")]
NO_NUMBERS = ((INF, "a finite number"), (NAN, "a finite number"), ("x", "a number"), (None, "a number"))
DOFS: list[Case] = [
    *((f"{field} {value}", hinge(**{field: value}), ("joint 'new'", f"{field} must be {rule}", repr(value)))
      for field in NOT_NEGATIVE for value, rule in ((-1.0, "zero or positive"), *NO_NUMBERS)),
    *((f"{field} {value}", hinge(**{field: value}), ("joint 'new'", f"{field} must be {rule}", repr(value)))
      for field in ("preload", "rest") for value, rule in ((-INF, "a finite number"), *NO_NUMBERS)),
    *((f"limit {value}", hinge(limit=value), ("joint 'new'", "limit must be (lower, upper)", repr(value), "None"))
      for value in ((1.0, 1.0), (2.0, 1.0), (NAN, 1.0), (0.0, NAN), (INF, INF), (-INF, -INF), (1.0,), (0, 1, 2), 3.0,
                    "ab", ("a", "b"))),
    *((f"{field} {table}", hinge(**{field: table}), ("joint 'new'", field, "increasing", "write ((x0"))
      for field in ("spring_table", "damper_table")
      for table in (((0.0,), (1.0,)), ((0.0, 0.0), (1.0, 2.0)), ((1.0, 0.0), (1.0, 2.0)), ((0.0, 1.0), (1.0,)),
                    ((0.0, NAN), (1.0, 2.0)), ((0.0, 1.0), (1.0, INF)), ((0.0, INF), (1.0, 2.0)), (0.0, 1.0), (), "ab",
                    ((0.0, 1.0), (0.0, 1.0), (2.0, 3.0)), (("a", "b"), (0.0, 1.0)))),
    *((f"drive {drive}", hinge(drive=drive), ("joint 'new'", "drive", *parts)) for drive, *parts in (
        (PositionDrive(stiffness=-1.0), "stiffness must be zero or positive", "-1.0"),
        (PositionDrive(stiffness=INF), "stiffness", "inf"),
        (PositionDrive(stiffness=NAN), "stiffness", "nan"),
        (PositionDrive(stiffness=1.0, damping=INF), "damping", "inf"),
        (PositionDrive(stiffness=1.0, damping=-2.0), "damping", "-2.0"),
        (PositionDrive(stiffness=1.0, effort_limit=0.0), "effort_limit must be positive", "0.0", "inf"),
        (PositionDrive(stiffness=1.0, effort_limit=NAN), "effort_limit", "nan"),
        (PositionDrive(stiffness=1.0, effort_limit=(1.0, 2.0)), "effort_limit must be (lower, upper)", "(1.0, 2.0)"),
        (PositionDrive(stiffness=1.0, effort_limit=(2.0, -1.0)), "lower <= 0 <= upper", "(2.0, -1.0)"),
        (PositionDrive(stiffness=1.0, effort_limit=(0.0, 0.0)), "lower < upper", "(0.0, 0.0)", "inf"),
        (PositionDrive(stiffness=1.0, effort_limit=(NAN, 1.0)), "effort_limit", "nan"),
        (PositionDrive(stiffness=1.0, effort_limit=THREE), "effort_limit", "(-1.0, 0.0, 1.0)"),
        (VelocityMotor(effort_limit=(-INF, INF)), "finite on one side", "(-inf, inf)", "PrescribedSpeed"),
        (VelocityMotor(effort_limit=(-1.0, -0.5)), "effort_limit must be (lower, upper)", "(-1.0, -0.5)"),
        (VelocityMotor(effort_limit=0.0), "effort_limit must be positive and finite", "0.0"),
        (VelocityMotor(effort_limit=INF), "effort_limit", "inf", "PrescribedSpeed"),
        (VelocityMotor(effort_limit=NAN), "effort_limit", "nan"),
        (PrescribedPosition(table=((0.0,), (0.0,))), "table", "increasing"),
        (PrescribedSpeed(table=((1.0, 0.0), (0.0, 0.0))), "table", "increasing"),
        ("position", "PositionDrive", "'position'", "construct"),
        (PositionDrive, "PositionDrive", "construct"),
        (3.0, "PositionDrive", "3.0"),
    )),
]  # fmt: skip
COUPLINGS: list[Case] = [
    ("no term", lambda b: b.add_coupling("new", []), ("coupling 'new'", "1 to 12 terms", "0")),
    ("thirteen terms", lambda b: b.add_coupling("new", [(0, 1.0)] * 13), ("coupling 'new'", "1 to 12", "13", "chain")),
    ("no list", lambda b: b.add_coupling("new", 3), ("coupling 'new'", "terms", "3", "[(joint")),
    ("flat list", lambda b: b.add_coupling("new", [0, 1.0]), ("coupling 'new'", "a term must be", "0", "tuples")),
    ("no such joint", lambda b: b.add_coupling("new", [(9, 1.0)]), ("coupling 'new'", "0..4", "9", "add_joint")),
    ("joint by name", lambda b: b.add_coupling("new", [("hinge", 1.0)]), ("coupling 'new'", "'hinge'", "returned")),
    ("no coordinate", lambda b: b.add_coupling("new", [(2, 1.0)]), ("coupling 'new'", "'weld'", "0 coordinates")),
    ("third coordinate", lambda b: b.add_coupling("new", [(3, 2, 1.0)]), ("coupling 'new'", "'thread'", "2")),
    ("NaN", lambda b: b.add_coupling("new", [(0, NAN)]), ("coupling 'new'", "coefficient", "nan")),
    ("zero", lambda b: b.add_coupling("new", [(0, 0.0), (1, 1.0)]), ("coupling 'new'", "not be 0", "leave the term")),
    ("offset", lambda b: b.add_coupling("new", [(0, 1.0)], offset=NAN), ("coupling 'new'", "offset", "nan", "None")),
    ("ratio", lambda b: b.add_gear("new", 0, 4, ratio=INF), ("coupling 'new'", "ratio", "inf")),
    ("rack on a rack", lambda b: b.add_rack("new", 1, 1, radius=1.0), ("rack 'new'", "pinion", "angle", "'slide'")),
    ("rack that turns", lambda b: b.add_rack("new", 0, 4, radius=1.0), ("rack 'new'", "rack", "length", "'shaft'")),
    (
        "screw on a hinge",
        lambda b: b.add_screw("new", 0, lead=0.1),
        ("screw 'new'", "CYLINDRICAL", "REVOLUTE", "'hinge'"),
    ),
    ("lead", lambda b: b.add_screw("new", 3, lead=NAN), ("screw 'new'", "lead", "nan")),
    ("name", lambda b: (b.add_gear("g", 0, 4, ratio=1.0), b.add_gear("g", 0, 4, ratio=2.0)), ("coupling 'g'", "taken")),
]
FINISH: list[Case] = [
    ("no worlds", lambda b: b.finalize(0, "cpu"), ("finalize", "world_count must be an integer >= 1", "0")),
    ("half a world", lambda b: b.finalize(1.5, "cpu"), ("finalize", "world_count", "1.5")),
    ("a bool", lambda b: b.finalize(True, "cpu"), ("finalize", "world_count", "True")),
    ("no device", lambda b: b.finalize(1, "tpu:0"), ("device 'tpu:0'", "not available", "use one of", "cpu")),
    ("nothing", lambda b: ModelBuilder().finalize(1, "cpu"), ("finalize", "no body", "add_body")),
    ("unknown parameter", lambda b: b.finalize(1, "cpu", per_world=["body_masss"]),
     ("finalize", "body_masss", "did you mean 'body_mass'")),
    ("parameter as text", lambda b: b.finalize(1, "cpu", per_world="gravity"),
     ("finalize", "per_world must be a list", "'gravity'", "['gravity']")),
    ("no such body", lambda b: b.finalize(1, "cpu").body("q"), ("body", "'q'", "did you mean")),
    ("no such joint", lambda b: b.finalize(1, "cpu").joint("hinges"), ("joint", "'hinges'", "'hinge'")),
]  # fmt: skip


def named(cases: list[Case]) -> list:
    return [pytest.param(call, parts, id=name) for name, call, parts in cases]


def check(b: ModelBuilder, call: Callable[[Any], object], parts: tuple[str, ...]) -> None:
    with pytest.raises(ModelError) as caught:
        call(b)
    message = str(caught.value)
    assert [part for part in parts if part not in message] == [], message
    assert "\n" not in message
    assert len(message) < 400


@pytest.mark.parametrize(("call", "parts"), named(BODIES))
def test_bodies(b, call, parts):
    count = len(b.bodies)
    check(b, call, parts)
    assert len(b.bodies) == count  # nothing half made


@pytest.mark.parametrize(("call", "parts"), named(SHAFTS + JOINTS + DOFS))
def test_joints(b, call, parts):
    count = len(b.joints)
    check(b, call, parts)
    assert len(b.joints) == count


@pytest.mark.parametrize(("call", "parts"), named(FREE))
def test_free_joints(b, call, parts):
    check(b, call, parts)


@pytest.mark.parametrize(("call", "parts"), named(COUPLINGS))
def test_couplings(b, call, parts):
    check(b, call, parts)


@pytest.mark.parametrize(("call", "parts"), named(FINISH))
def test_finish(b, call, parts):
    check(b, call, parts)


@pytest.mark.parametrize(("call", "parts"), named(BODIES + SHAFTS + JOINTS + FREE + DOFS + COUPLINGS))
def test_every_message_offers_a_remedy(b, call, parts):
    """After the value there is one more clause that says what to do."""
    with pytest.raises(ModelError) as caught:
        call(b)
    message = str(caught.value)
    assert "; " in message
    assert len(message.rsplit("; ", 1)[1].split()) >= 2, message


def test_couplings_that_only_the_topology_can_judge():
    builder = ModelBuilder()
    for k in range(2):
        builder.add_body(f"b{k}", mass=1.0, inertia=(1, 1, 1), pose=pose((k, 0, 0)))
    ball = builder.add_joint_spherical("ball", WORLD, 0, anchor=(0, 0, 0))
    builder.add_coupling("bad", [(ball, 0, 1.0)])
    with pytest.raises(ModelError, match=r"coupling 'bad'.*'ball' is SPHERICAL.*couple revolute"):
        builder.finalize(1, "cpu")


def test_a_closed_ring_of_coupled_joints():
    """All joints of a loop coupled: one of them has to close it, and that one has no slot to couple."""
    builder = ModelBuilder()
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    for k in range(3):
        builder.add_body(f"b{k}", mass=1.0, inertia=(1, 1, 1), pose=pose(np.add(corners[k], 0.1)))
    ends = [(WORLD, 0), (0, 1), (1, 2), (2, WORLD)]
    joints = [builder.add_joint_revolute(f"j{k}", *ends[k], axis=(0, 0, 1), anchor=corners[k]) for k in range(4)]
    builder.add_gear("first", joints[0], joints[1], ratio=2.0)
    builder.add_gear("second", joints[2], joints[3], ratio=2.0)
    with pytest.raises(ModelError, match=r"coupling 'second'.*'j3' closes a loop.*couple another"):
        builder.finalize(1, "cpu")


def test_a_long_chain_is_no_error():
    builder = ModelBuilder()
    parent = WORLD
    for k in range(300):
        child = builder.add_body(f"b{k}", mass=1.0, inertia=(1, 1, 1), pose=pose((k, 0, 0)))
        builder.add_joint_revolute(f"j{k}", parent, child, axis=(0, 1, 0))
        parent = child
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-4)
    sim.step()
    assert np.isfinite(sim.state.body_v.numpy()).all()
    assert sim.diagnostics.row_residual.numpy()[0] == 0.0  # no loop rows


# ---- what is legal ---------------------------------------------------------------------------------------------------

LEGAL: dict[str, Callable[[Any], object]] = {
    "tiny and huge": lambda b: (
        b.add_body("dust", mass=1e-9, inertia=(1e-15, 1e-15, 1e-15)),
        b.add_body("ship", mass=1e9, inertia=(1e12, 2e12, 2e12)),
    ),
    "flat plate": body(inertia=(1.0, 1.0, 2.0)),
    "thin rod": body(inertia=(1e-9, 1.0, 1.0)),
    "rounded table": body(inertia=(1.0, 1.0, 2.01)),
    "full inertia": body(inertia=[[2, 0.1, 0], [0.1, 2, 0], [0, 0, 2]]),
    "one stop": hinge(limit=(-INF, 1.0)),
    "other stop": hinge(limit=(0.0, INF)),
    "limit as list": hinge(limit=[0, 1]),
    "limit as array": hinge(limit=np.array([0.0, 1.0])),
    "limit away from the start": hinge(limit=(0.5, 1.0)),
    "negative rest and preload": hinge(rest=-1.0, preload=-3.0),
    "zero gains": hinge(drive=PositionDrive(stiffness=0.0)),
    "table of arrays": hinge(spring_table=(np.array([0.0, 1.0]), np.array([1.0, 0.0]))),
    "table of lists": hinge(drive=PrescribedPosition(table=([0, 1, 2], [0, 1, 0]))),
    "numpy index": lambda b: b.add_joint_fixed("new", np.int64(0), np.int32(2)),
    "numpy mass": body(mass=np.float32(2.0)),
    "world as child": lambda b: b.add_joint_fixed("new", 3, WORLD),
    "second joint between two bodies": lambda b: b.add_joint_revolute("new", 0, 1, axis=(0, 0, 1)),
    "dofs as tuple": lambda b: b.add_joint_cylindrical("new", 0, 1, axis=(1, 0, 0), dofs=(Dof(), Dof(damping=1.0))),
    "terms from a generator": lambda b: b.add_coupling("new", ((j, 1.0) for j in (0, 1))),
    "numpy terms": lambda b: b.add_coupling("new", [(np.int64(0), np.float64(1.0)), (np.int64(3), np.int64(1), 2)]),
    "planar direction off the link": lambda b: b.add_joint_revolute_translational(
        "new", 0, 1, anchor0=(0, 0, 0), axis=(0, 0, 2), anchor1=(1, 1, 0), direction=(3, 0, 0)),
    "link with rounded anchors": lambda b: b.add_joint_revolute_spherical(
        "new", 0, 1, anchor0=(0, 0, 0), axis=(0, 0, 1), anchor1=(1, 0, 1e-8)),
    "free beside the others": lambda b: (b.add_body("e", mass=1, inertia=(1, 1, 1)), b.add_joint_free("f", 4)),
    "free held by a rod": lambda b: (
        b.add_body("e", mass=1, inertia=(1, 1, 1)),
        b.add_joint_distance("rod", 0, 4, anchor0=(0, 0, 1), anchor1=(0, 0, 0)),
        b.add_joint_free("f", 4)),
}  # fmt: skip


@pytest.mark.parametrize("call", LEGAL.values(), ids=LEGAL)
def test_legal(b, call):
    call(b)
    sim = sw.Simulation(b.finalize(1, "cpu"), 1e-3)
    sim.step()
    assert sim.state.world_status.numpy()[0] == 0
    assert np.isfinite(sim.state.body_v.numpy()).all()


def test_a_pose_that_was_made_by_hand_is_normalised():
    builder = ModelBuilder()
    builder.add_body("b", mass=1.0, inertia=(1, 1, 1), pose=Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 2.0])))
    np.testing.assert_array_equal(builder.bodies[0].pose.rotation, (0.0, 0.0, 0.0, 1.0))


def test_every_joint_type_has_an_element_and_a_way_in():
    """Closed sets: each member of JointType is defined once, and some method of the builder adds it."""
    assert set(ELEMENTS) == set(JointType)
    builder = ModelBuilder()
    for k in range(20):
        builder.add_body(f"b{k}", mass=1.0, inertia=(1, 1, 1), pose=pose((k, 0, 0)))
    at, axis, apart = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
    builder.add_joint_free("free", 19)
    builder.add_joint_fixed("fixed", 0, 1)
    builder.add_joint_revolute("revolute", 0, 2, axis=axis)
    builder.add_joint_prismatic("prismatic", 0, 3, axis=axis)
    builder.add_joint_spherical("spherical", 0, 4, anchor=at)
    builder.add_joint_cylindrical("cylindrical", 0, 5, axis=axis)
    builder.add_joint_universal("universal", 0, 6, anchor=at, axis0=axis, axis1=apart)
    builder.add_joint_planar("planar", 0, 7, normal=axis)
    builder.add_shaft("shaft", inertia=1.0)
    builder.add_joint_point_on_plane("plane", 0, 8, anchor=at, normal=axis)
    builder.add_joint_point_on_line("line", 0, 9, anchor=at, axis=axis)
    builder.add_joint_parallel("parallel", 0, 10, axis=axis)
    builder.add_joint_perpendicular("perpendicular", 0, 11, axis0=axis, axis1=apart)
    builder.add_joint_oldham("oldham", 0, 12, anchor=at, normal=axis)
    builder.add_joint_distance("rod", 0, 13, anchor0=at, anchor1=apart)
    builder.add_spring("spring", 0, 14, anchor0=at, anchor1=apart, stiffness=1.0)
    builder.add_joint_revolute_spherical("rs", 0, 15, anchor0=at, axis=axis, anchor1=apart)
    builder.add_joint_revolute_translational("rt", 0, 16, anchor0=at, axis=axis, anchor1=apart, direction=apart)
    builder.add_bushing("bushing", 0, 17, anchor=at, stiffness=[1.0] * 6)
    builder.add_joint_elastic("elastic", 0, 18, anchor0=at, anchor1=apart, stiffness=[1.0] * 6)
    builder.add_joint_relative_rotation("turn", 0, 18, axis=axis)
    builder.add_combination("sum", [(2, 1.0), (3, -1.0)], friction=0.1)
    assert {joint.type for joint in builder.joints} == set(JointType)
    assert builder.dof_count == builder.dof_start(len(builder.joints))
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    sim.step()
    assert sim.state.world_status.numpy()[0] == 0


def test_rows_and_coordinates_of_a_joint_fill_six():
    """A joint that can be eliminated locks what it does not let move."""
    for kind, element in ELEMENTS.items():
        if element.tree and kind not in (JointType.SHAFT, JointType.FREE):
            assert len(element.rows) + len(element.dofs) == 6, kind
