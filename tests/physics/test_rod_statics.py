"""Rods at rest: the float64 reference against theory, literature, recorded runs and differential equations."""

from __future__ import annotations

import csv
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from tests.physics import rod_cases
from tests.reference import rod_continuum, rod_sections, rods
from tests.reference.rod_models import loads_of, rods_of, section_of, supports_of
from tests.reference.rods import Array

RECORDED = Path(__file__).parents[3] / "shared/reference/chrono/flexible"
"""Runs of Project Chrono beside the checkout."""


def _random_rods(seed: int) -> tuple[rods.Rods, rods.Pose]:
    """Seven elements of any stiffness in any pose, with a curved rest shape."""
    random = np.random.default_rng(seed)
    points = np.cumsum(random.normal(size=(8, 3)), axis=0)
    model, pose = rods.build(points, random.uniform(1.0, 5.0, 6))
    turn = rods.exponential(random.normal(size=(8, 3)) * 0.8)
    return model, rods.Pose(pose.position + 0.3 * random.normal(size=(8, 3)), turn @ pose.rotation)


@pytest.mark.parametrize("seed", range(3))
def test_derivatives_of_strains_are_exact(seed: int) -> None:
    """Against central differences, whose own error is about 1e-10."""
    model, pose = _random_rods(seed)
    matrix = rods.strain_matrix(model, pose)
    for unknown in range(model.nodes * 6):
        change = np.zeros(model.nodes * 6)
        change[unknown] = 1e-6
        numeric = (rods.strains(model, pose.moved(change)) - rods.strains(model, pose.moved(-change))) / 2e-6
        exact = np.where(model.dofs[:, None, :] == unknown, matrix, 0.0).sum(axis=2)
        assert np.abs(numeric - exact).max() < 3e-9


def test_forces_are_the_slope_of_the_energy_and_balance() -> None:
    model, pose = _random_rods(4)
    force = rods.forces(model, pose)
    for unknown in range(model.nodes * 6):
        change = np.zeros(model.nodes * 6)
        change[unknown] = 1e-6
        slope = (
            rods.elastic_energy(model, pose.moved(change)) - rods.elastic_energy(model, pose.moved(-change))
        ) / 2e-6
        assert abs(slope + force[unknown]) < 1e-6 * np.abs(force).max()
    each = force.reshape(-1, 6)
    moment = each[:, 3:] + np.cross(pose.position, each[:, :3])
    assert np.abs(each[:, :3].sum(axis=0)).max() < 1e-12 * np.abs(force).max()
    assert np.abs(moment.sum(axis=0)).max() < 1e-11 * np.abs(force).max()


def test_a_rigid_motion_changes_no_strain() -> None:
    model, pose = _random_rods(5)
    turn = rods.exponential(np.array([1.1, -0.7, 2.0]))
    moved = rods.Pose(pose.position @ turn.T + np.array([3.0, -2.0, 5.0]), turn @ pose.rotation)
    assert np.abs(rods.strains(model, moved) - rods.strains(model, pose)).max() < 1e-13


@pytest.mark.parametrize(
    "points", [rod_cases.arc(0.5, 2.0), tuple((math.cos(k), math.sin(k), 0.1 * k) for k in range(9))]
)
def test_a_curved_rest_shape_has_no_force(points: tuple[rod_cases.Vector, ...]) -> None:
    """Twisted as well: each frame is turned about the rod by 0.2 more than the one before."""
    positions = np.array(points)
    frames = rods.frames_along(positions, np.array([0.0, 0.0, 1.0]))
    turned = frames @ rods.exponential(np.outer(0.2 * np.arange(len(points)), [1.0, 0.0, 0.0]))
    stiffness = np.full(6, 1e6)
    for given in (frames, turned):
        model, pose = rods.build(positions, stiffness, frames=given)
        assert np.abs(rods.forces(model, pose)).max() < 1e-9


def test_sections() -> None:
    """Against tables: a square's torsion constant 0.1406 a^4, Cowper's factors, a thin strip, a nearly full tube."""
    square = rod_sections.rectangle_section(0.02, 0.02)
    assert square.torsion == pytest.approx(0.140577 * 0.02**4, rel=1e-5)
    assert rod_sections.rectangle_torsion(0.002, 1.0) == pytest.approx(0.002**3 / 3.0 * (1.0 - 0.63 * 0.002), rel=1e-5)
    assert rod_sections.rectangle_torsion(0.3, 0.1) == pytest.approx(0.2633 * 0.3 * 0.1**3, rel=1e-3)
    cowper = rod_sections.Factors.COWPER
    assert rod_sections.rectangle_section(1.0, 2.0, 0.3, cowper).shear_y == pytest.approx(0.8497, abs=1e-4)
    assert rod_sections.round_section(1.0, 0.3, cowper).shear_y == pytest.approx(0.8864, abs=1e-4)
    assert rod_sections.tube_section(1.0, 0.999, 0.3, cowper).shear_y == pytest.approx(0.5306, abs=1e-3)
    full, hollow = rod_sections.round_section(0.3, 0.3, cowper), rod_sections.tube_section(0.3, 1e-6, 0.3, cowper)
    assert dataclasses.astuple(hollow) == pytest.approx(dataclasses.astuple(full), rel=1e-8)


def _position(case: rod_cases.StaticCase) -> Array:
    """Where the reference puts the node of a case."""
    model, pose = rods_of(case.beam)
    bent = rods.equilibrium(model, pose, loads_of(case, model), supports_of(case.beam), steps=case.steps)
    return bent.position[case.node]


def _holds(case: rod_cases.StaticCase) -> None:
    found, expected = _position(case), np.array(case.expected)
    known = np.isfinite(expected)
    assert np.abs(found - expected)[known].max() <= case.tolerance, f"{found} and not {expected}; {case.source}"


@pytest.mark.parametrize("case", rod_cases.static_cases(), ids=lambda case: case.name)
def test_static_case(case: rod_cases.StaticCase) -> None:
    _holds(case)


@pytest.mark.sweep
@pytest.mark.parametrize("case", rod_cases.princeton_cases(), ids=lambda case: case.name)
def test_princeton_beam(case: rod_cases.StaticCase) -> None:
    """Within one per cent of the exact rod, and of beam elements of ANSYS."""
    _holds(case)


def _continuum(case: rod_cases.StaticCase) -> Array:
    """The tip of a case by the differential equations; loads are dead and at the tip."""
    beam = case.beam
    section = section_of(beam.section, beam.poisson)
    points = np.array(beam.points)
    length, curvature = beam.length, 0.0
    if np.ptp(points[:, 1]) > 0.0:  # an arc of the plane
        curvature = 1.0 / 100.0
        length = rod_cases.BEND_LENGTH
    force = case.loads[0].force
    rod = rod_continuum.Cantilever(
        length, tuple(section.stiffness(beam.young, beam.poisson)), force=force, curvature=(0.0, 0.0, curvature)
    )
    return rod_continuum.tip(rod)[0]


@pytest.mark.parametrize("name", ["45 degree bend, 300", "45 degree bend, 600", "deep cantilever", "elastica, 3"])
def test_expected_tips_are_those_of_the_exact_rod(name: str) -> None:
    """The case's own number is from literature or was recorded; inextensible ones differ by P / E A."""
    case = {case.name: case for case in rod_cases.static_cases()}[name]
    assert np.abs(_continuum(case) - np.array(case.expected)).max() < 2e-4 * max(1.0, 0.01 * case.beam.length)


@pytest.mark.parametrize("force", rod_cases.PRINCETON_FORCES)
def test_princeton_tips_are_those_of_the_exact_rod(force: float) -> None:
    for angle in (15.0, 45.0, 90.0):
        case = rod_cases.princeton(force, angle)
        assert np.abs(_continuum(case) - np.array(case.expected)).max() < 1e-7


@pytest.mark.parametrize("force", [8.896, 13.345])
def test_princeton_tips_are_those_of_other_beam_elements(force: float) -> None:
    """1 % of the deflection: they give the section slightly other constants of torsion and shear."""
    across, along = rod_cases.PRINCETON_ANSYS[force]
    exact = np.array(rod_cases.PRINCETON_EXACT[force])
    size = np.hypot(across, along)
    assert np.all(np.hypot(np.abs(exact[:, 1]) - across, np.abs(exact[:, 2]) - along) < 0.01 * size)


@pytest.mark.parametrize("force", [300.0, 600.0])
def test_the_bend_is_that_of_literature(force: float) -> None:
    """One per cent of the length: literature has eight linear elements."""
    case = {case.name: case for case in rod_cases.static_cases()}[f"45 degree bend, {force:.0f}"]
    off = np.abs(np.array(case.expected) - np.array(rod_cases.BEND_LITERATURE[force]))
    assert off.max() < 0.01 * rod_cases.BEND_LENGTH


def test_order_in_the_length_of_an_element_is_two() -> None:
    """Errors of the deep cantilever with 8, 16 and 32 elements."""
    case = {case.name: case for case in rod_cases.static_cases()}["deep cantilever"]
    exact = _continuum(case)
    errors = []
    for elements in (8, 16, 32):
        beam = dataclasses.replace(case.beam, points=rod_cases.straight(2.0, elements))
        errors.append(float(np.linalg.norm(_position(dataclasses.replace(case, beam=beam)) - exact)))
    assert 1.9 < math.log2(errors[0] / errors[1]) < 2.1
    assert 1.9 < math.log2(errors[1] / errors[2]) < 2.1


def test_catenary() -> None:
    """Sag to 0.5 %, forces of the ends to 1 %; the case's numbers against the equations."""
    case = rod_cases.catenary_case()
    model, pose = rods_of(case.beam)
    loads = loads_of(case, model)
    hung = rods.equilibrium(model, pose, loads, {0: (0, 1, 2, 3), -1: rods.HINGE})  # nothing else holds its turning
    assert np.abs(hung.position[case.node] - np.array(case.expected)).max() < case.tolerance
    force = rods.reactions(model, hung, loads)
    horizontal, vertical = rod_cases.CATENARY_FORCE
    for node, side in ((0, -1.0), (-1, 1.0)):
        assert force[node, 0] == pytest.approx(side * horizontal, rel=0.01)
        assert force[node, 2] == pytest.approx(vertical, rel=0.01)
    area = math.pi * rod_cases.CATENARY_RADIUS**2
    exact = rod_continuum.Catenary(
        rod_cases.CATENARY_SPAN, rod_cases.CATENARY_LENGTH, 9810.0 * area, rod_cases.CATENARY_YOUNG * area
    )
    assert exact.sag() == pytest.approx(rod_cases.CATENARY_SAG, rel=1e-8)
    assert exact.end_force() == pytest.approx(rod_cases.CATENARY_FORCE, rel=1e-8)


def test_the_buckled_tip_is_that_of_the_exact_rod() -> None:
    case = {case.name: case for case in rod_cases.static_cases()}["buckling, 1.05"]
    section = section_of(case.beam.section, case.beam.poisson)
    load = 1.05 * rod_cases.buckling_load()
    rod = rod_continuum.Cantilever(
        1.0, tuple(section.stiffness(case.beam.young, case.beam.poisson)), force=(-load, 0, 0)
    )
    found, _ = rod_continuum.tip(rod, guess=np.array([0.0, 0.0, 0.4 * load]))
    assert np.abs(found - np.array(rod_cases.BUCKLED)).max() < 1e-7


def _ring(twist: float, elements: int = 40) -> float:
    """Smallest eigenvalue of a ring's stiffness beside the one of its rolling about its own axis, which is zero."""
    angle = np.linspace(0.0, 2.0 * math.pi, elements + 1)
    cosine, sine, zero = np.cos(angle), np.sin(angle), 0.0 * angle
    axes = [
        np.stack(axis, axis=1) for axis in ((-sine, cosine, zero), (-cosine, -sine, zero), (zero, zero, zero + 1.0))
    ]
    turned = rods.exponential(np.outer(twist * np.arange(elements + 1) / elements, [1.0, 0.0, 0.0]))
    stiffness = section_of(rod_cases.round_numbers(0.01), 0.3).stiffness(1e9, 0.3)
    points = np.stack([cosine, sine, zero], axis=1)
    model, pose = rods.build(points, stiffness, frames=np.stack(axes, axis=2) @ turned, straight=True)
    ends = {0: rods.CLAMP, -1: rods.CLAMP}
    pose = rods.equilibrium(model, pose, rods.no_loads(model.nodes), ends)
    values = np.linalg.eigvalsh(rods.free_tangent(model, pose, ends))
    return float(min(values, key=lambda value: (abs(value) < 1e-6, value)))


def test_a_twisted_ring_writhes_where_michell_says() -> None:
    """The stiffness loses its sign within 2 % of 2 pi sqrt(3) E I / G J; discs, so that the ratio is 1 + nu."""
    critical = 2.0 * math.pi * math.sqrt(3.0) * 1.3
    assert _ring(0.98 * critical) > 0.0
    assert _ring(1.02 * critical) < 0.0


@pytest.mark.skipif(not RECORDED.is_dir(), reason="recorded runs of Chrono are not beside the checkout")
def test_recorded_cantilevers() -> None:
    """ANCF cables and corotational beams of 32 elements: 0.3 % of the deflection, up to ten times E I / L^2."""
    with (RECORDED / "fea_a_cantilever_static.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["N"] == "32"]
    assert rows
    shape = {case.name: case for case in rod_cases.static_cases()}["elastica, 1"]
    for row in rows:
        load = rod_cases.Load((0.0, 0.0, -float(row["P_N"])))
        case = dataclasses.replace(shape, loads=(load,), steps=8)
        found = _position(case)
        recorded = np.array([float(row["tip_x_m"]), 0.0, float(row["tip_z_m"])])
        exact = np.array([float(row["elastica_x_m"]), 0.0, float(row["elastica_z_m"])])
        assert np.abs(found - recorded).max() < 0.003 * abs(recorded[2]), row
        assert np.abs(found - exact).max() < 0.003 * abs(exact[2]), row
