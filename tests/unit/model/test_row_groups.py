"""Rows are ordered by the trees that they tie together, against groups found by walking from body to body."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes
from simwarp.core.types import JointType
from simwarp.kernels.dynamics.dense_rows import padded
from simwarp.model.model import Model
from simwarp.model.topology import all_sums, dof_joints, row_paths
from tests.reference.machines import connected, machines
from tests.reference.mechanisms import NAMED, random_mechanism

APART = [(0.0, 5.0 * index, 0.0) for index in range(3)]


def model_of(builder: sw.ModelBuilder) -> Model:
    return builder.finalize(1, "cpu")


def response_nodes(model: Model) -> list[tuple[str, int]]:
    """Of each response in the order of `row_paths`, one of the bodies or shafts that it acts on."""
    builder, tables = model.builder, model.tables
    nodes = []
    owner = dof_joints(builder)
    joints = [
        (joint, tables.loop_row[index + 1] - tables.loop_row[index]) for index, joint in enumerate(tables.loop_joint)
    ]
    joints += [(owner[sum_.terms[0][0]], 1) for sum_ in all_sums(builder)]
    for joint, count in joints:
        spec = builder.joints[joint]
        node = ("shaft", joint) if spec.type == JointType.SHAFT else ("body", max(spec.parent, spec.child))
        nodes += [node] * count
    return nodes


def check(model: Model) -> None:
    """Every table of the groups against its meaning."""
    groups, tables, t = model.row_groups, model.tables, model.topology
    paths = row_paths(model.builder, tables)
    expected = connected(cast(sw.ModelBuilder, model.builder))
    assert sorted(groups.place) == list(range(len(paths)))
    assert t.row_count == groups.row_start[-1] == len(paths) - tables.silent_count
    assert groups.place[t.row_count :] == list(range(t.row_count, len(paths)))  # those without a row stay behind
    group_of_row = np.repeat(np.arange(len(groups.columns)), groups.row_counts)
    assert t.row_group.numpy()[: t.row_count].tolist() == group_of_row.tolist()
    path_start, path_dof = t.row_path.numpy(), t.path_tree_dof.numpy()
    path_column = t.path_column.numpy()
    met: dict[int, set[int]] = {}
    for row, (path, node) in enumerate(zip(paths, response_nodes(model), strict=True)):
        place = groups.place[row]
        entries = slice(path_start[place], path_start[place + 1])
        assert path_dof[entries].tolist() == path
        links = [tables.tree_dof_link[dof] for dof in path]
        assert len({groups.link_group[link] for link in links}) <= 1
        for dof, link, column in zip(path, links, path_column[entries], strict=True):
            assert column == dof - groups.link_column[link]
            assert 0 <= column < groups.columns[groups.link_group[link]]
        component = next(index for index, nodes in enumerate(expected) if node in nodes)
        if place < t.row_count:
            met.setdefault(component, set()).add(int(group_of_row[place]))
    # no two components in one group, no component in two
    assert all(len(numbers) == 1 for numbers in met.values())
    assert len({min(numbers) for numbers in met.values()}) == len(met)
    for group, columns in enumerate(groups.columns):
        taken = [
            dof - groups.link_column[link]
            for dof, link in enumerate(tables.tree_dof_link)
            if groups.link_group[link] == group
        ]
        assert sorted(taken) == list(range(columns))
        first, end = groups.row_start[group], groups.row_start[group + 1]
        assert groups.factor_start[group + 1] - groups.factor_start[group] == (end - first) * padded(end - first)
        kept = sorted((place, row) for row, place in enumerate(groups.place) if first <= place < end)
        assert [row for _, row in kept] == sorted(row for _, row in kept)  # in the order of before


@pytest.mark.parametrize("count", [1, 2, 3])
def test_machines_apart_are_groups(count):
    model = model_of(machines(APART[:count]))
    assert model.row_groups.row_counts == [7] * count  # five of the loop, gear, spring
    assert model.row_groups.columns == [10] * count
    assert model.row_groups.max_columns == 10
    assert model.row_groups.response_room == 80
    check(model)


@pytest.mark.parametrize("name", NAMED)
def test_named_scene(name):
    model = model_of(NAMED[name]())
    check(model)
    if len(model.row_groups.columns) < 2:
        assert model.row_groups.place == list(range(model.response_count))


@pytest.mark.parametrize("seed", range(8))
def test_random_mechanism(seed):
    check(model_of(random_mechanism(seed, couplings=True, bounds=True)))


def test_a_row_between_two_machines_makes_them_one():
    tied = machines(APART)
    tied.add_joint_distance("rod", 0, 2, anchor0=(0.0, 0.0, 0.1), anchor1=(0.0, 10.0, 0.1))
    model = model_of(tied)
    assert model.row_groups.row_counts == [15, 7]
    check(model)
    geared = machines(APART)
    shafts = [joint for joint, spec in enumerate(geared.joints) if spec.type == JointType.SHAFT]
    geared.add_coupling("belt", [(shafts[1], 1.0), (shafts[2], 1.0)])
    model = model_of(geared)
    assert model.row_groups.row_counts == [7, 15]
    check(model)


def test_a_sum_without_a_row_joins_as_well():
    builder = machines(APART)
    builder.add_combination("between", [(0, 1.0), (1, 1.0)], limit=(-0.1, 0.1))
    model = model_of(builder)
    assert model.row_groups.row_counts == [14, 7]
    check(model)


@pytest.mark.parametrize("on_a_block", [False, True])
def test_common_ground_ties_nothing(on_a_block):
    """Four-bars on the world, or on a body that is fixed to it."""
    builder = sw.ModelBuilder()
    ground = sw.WORLD
    if on_a_block:
        ground = builder.add_body("block", mass=1.0, inertia=(1.0, 1.0, 1.0))
        builder.add_joint_fixed("hold", sw.WORLD, ground)
    for index in range(2):
        points = [(0.0, index, 0.0), (0.0, index, 1.0), (1.0, index, 1.5), (1.0, index, 0.0)]
        rods = []
        for rod in range(3):
            middle = (np.array(points[rod]) + np.array(points[rod + 1])) / 2.0
            rods.append(
                builder.add_body(f"rod{rod}_{index}", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose(tuple(middle)))
            )
        for pin, (parent, child) in enumerate([(ground, 0), (0, 1), (1, 2), (ground, 2)]):
            builder.add_joint_revolute(
                f"pin{pin}_{index}", parent if pin in (0, 3) else rods[parent], rods[child], axis=(0.0, 1.0, 0.0),
                anchor=points[pin],
            )  # fmt: skip
    model = model_of(builder)
    assert model.row_groups.row_counts == [5, 5]
    assert model.row_groups.columns == [3, 3]


def test_rows_that_nothing_moves_stand_with_the_row_before_them():
    builder = machines(APART[:2])
    fixed = [builder.add_body(f"still{k}", mass=1.0, inertia=(1.0, 1.0, 1.0)) for k in range(2)]
    for body in fixed:
        builder.add_joint_fixed(f"hold{body}", sw.WORLD, body)
    builder.add_loop_joint("weld", *fixed, kind=JointType.FIXED, frame0=sw.pose(), frame1=sw.pose())
    model = model_of(builder)
    # rows of loop joints: the loop of machine 0, that of machine 1, the weld
    assert model.row_groups.row_counts == [7, 13]
    sim = sw.Simulation(model, 1e-3)
    sim.advance(5)
    assert np.isfinite(sim.state.body_v.numpy()).all()


def test_no_rows_no_groups():
    model = model_of(scenes.stack(count=2))
    assert model.topology.group_count == 0
    assert model.row_groups.row_start == [0]
    assert model.row_groups.max_columns == model.row_groups.response_room == model.share_width == 0
    assert set(model.row_groups.link_group) == {-1}


def test_a_block_sees_the_rows_of_two_groups_only_where_two_can_meet():
    assert model_of(machines(APART)).share_width == 7
    assert model_of(machines(APART, shapes=True)).share_width == 14
    one = machines(APART[:1], shapes=True)
    one.add_shape_plane()
    assert model_of(one).share_width == 7
    apart = machines(APART, shapes=True)
    for low in range(3):
        for high in range(low + 1, 3):
            apart.exclude_collision(low, high)
    assert model_of(apart).share_width == 7
    bounded = machines(APART)
    bounded.add_joint_distance("rope", 0, 1, anchor0=(0.0, 0.0, 0.1), anchor1=(0.0, 5.0, 0.1), limit=(0.0, 6.0))
    assert model_of(bounded).share_width == 14
