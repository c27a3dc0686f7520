"""Rods of the float64 reference from cases that know nothing of it (`tests.physics.rod_cases`)."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from tests.physics import rod_cases
from tests.reference import rod_sections, rods


def section_of(section: rod_cases.Section, poisson: float) -> rod_sections.Section:
    """The numbers of a section, with plain factors of shear."""
    match section.shape:
        case rod_cases.Shape.ROUND:
            return rod_sections.round_section(section.sizes[0], poisson)
        case rod_cases.Shape.TUBE:
            return rod_sections.tube_section(section.sizes[0], section.sizes[1], poisson)
        case rod_cases.Shape.RECTANGLE:
            return rod_sections.rectangle_section(section.sizes[0], section.sizes[1], poisson)
        case rod_cases.Shape.NUMBERS:
            return rod_sections.Section(*section.sizes)


def rods_of(beam: rod_cases.Beam) -> tuple[rods.Rods, rods.Pose]:
    """Elements and the rest pose."""
    section = section_of(beam.section, beam.poisson)
    second = np.array([section.inertia_y + section.inertia_z, section.inertia_y, section.inertia_z])
    return rods.build(
        np.array(beam.points),
        section.stiffness(beam.young, beam.poisson),
        density_area=beam.density * section.area,
        polar=beam.density * second,
        up=beam.up,
    )


def supports_of(beam: rod_cases.Beam) -> dict[int, Sequence[int]]:
    """Unknowns that the ends hold."""
    which: dict[rod_cases.End, Sequence[int]] = {
        rod_cases.End.LOOSE: (),
        rod_cases.End.CLAMP: rods.CLAMP,
        rod_cases.End.HINGE: rods.HINGE,
        rod_cases.End.GUIDE: (1, 2),
    }
    return {0: which[beam.start], -1: which[beam.end]}


def loads_of(case: rod_cases.StaticCase, model: rods.Rods) -> rods.Loads:
    """Loads and weight of a case."""
    out = rods.Loads(rods.weight(model, case.gravity), np.zeros((model.nodes, 6)))
    for load in case.loads:
        onto = out.following if load.follows else out.dead
        onto[load.node] += np.concatenate([load.force, load.moment])
    return out


def with_mass(model: rods.Rods, node: int, mass: float) -> rods.Rods:
    """A point mass on a node [kg]."""
    masses = model.mass.copy()
    masses[node] += mass
    return dataclasses.replace(model, mass=masses)


def together(parts: Sequence[tuple[rods.Rods, rods.Pose]]) -> tuple[rods.Rods, rods.Pose]:
    """Several rods as one model; nodes are numbered on."""
    models, poses = zip(*parts, strict=True)
    first = np.cumsum([0, *(model.nodes for model in models)])
    elements = np.concatenate([model.elements + start for model, start in zip(models, first, strict=False)])
    names = ("length", "rest", "stiffness", "mass", "inertia")
    arrays = {name: np.concatenate([getattr(model, name) for model in models]) for name in names}
    positions, rotations = ([getattr(pose, name) for pose in poses] for name in ("position", "rotation"))
    return rods.Rods(elements=elements, **arrays), rods.Pose(np.concatenate(positions), np.concatenate(rotations))
