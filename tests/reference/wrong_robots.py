"""Robots that start in states that no motion leads to, as published ones do: URDF texts, small, made of boxes,
cylinders, spheres and hulls.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import hypothesis.strategies as st

CUBE = """solid cube
{}
endsolid cube
"""
CUBE_FACES = (
    ((0, 2, 1), (0, 3, 2)), ((4, 5, 6), (4, 6, 7)), ((0, 1, 5), (0, 5, 4)),
    ((1, 2, 6), (1, 6, 5)), ((2, 3, 7), (2, 7, 6)), ((3, 0, 4), (3, 4, 7)),
)  # fmt: skip
CUBE_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))


def cube_stl() -> str:
    """A mesh file: a cube with its corner in the origin, of 1 m."""
    facets = []
    for face in CUBE_FACES:
        for triangle in face:
            corners = "\n".join(f"vertex {x} {y} {z}" for x, y, z in (CUBE_CORNERS[index] for index in triangle))
            facets.append(f"facet normal 0 0 0\nouter loop\n{corners}\nendloop\nendfacet")
    return CUBE.format("\n".join(facets))


def _numbers(values: Sequence[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)


@dataclasses.dataclass(frozen=True)
class Part:
    """A link with the joint above it.

    Attributes:
        parent: index of the part that it hangs on; None for the first.
        at: origin of its frame in the parent's [m].
        shapes: texts of geometries with their origins.
        kind: of the joint.
        axis: of it.
        limit: of it; None for none.
        mass: [kg]; None for a link without <inertial>.
        radius: of gyration, in all directions [m].
        centre: of mass, in its frame [m].
        mimic: index of the part whose joint it follows, and the factor.
    """

    parent: int | None
    at: Sequence[float] = (0.0, 0.0, 0.0)
    shapes: Sequence[tuple[str, Sequence[float]]] = ()
    kind: str = "revolute"
    axis: Sequence[float] = (0.0, 1.0, 0.0)
    limit: tuple[float, float] | None = None
    mass: float | None = 1.0
    radius: float = 0.05
    centre: Sequence[float] = (0.0, 0.0, 0.0)
    mimic: tuple[int, float] | None = None


def box(x: float, y: float, z: float) -> str:
    """A geometry, edges [m]."""
    return f'<box size="{_numbers((x, y, z))}"/>'


def sphere(radius: float) -> str:
    """A geometry [m]."""
    return f'<sphere radius="{radius:.9g}"/>'


def cylinder(radius: float, length: float) -> str:
    """A geometry [m]."""
    return f'<cylinder radius="{radius:.9g}" length="{length:.9g}"/>'


def mesh(scale: float) -> str:
    """`cube_stl` in a file beside the robot, with edges of this length [m]."""
    return f'<mesh filename="cube.stl" scale="{_numbers((scale,) * 3)}"/>'


def urdf(parts: Sequence[Part]) -> str:
    """The text of a robot."""
    lines = ['<robot name="wrong">']
    for index, part in enumerate(parts):
        lines.append(f'<link name="link{index}">')
        if part.mass is not None:
            inertia = part.mass * part.radius**2
            lines.append(
                f'<inertial><origin xyz="{_numbers(part.centre)}"/><mass value="{part.mass:.9g}"/>'
                f'<inertia ixx="{inertia:.9g}" iyy="{inertia:.9g}" izz="{inertia:.9g}" ixy="0" ixz="0" iyz="0"/>'
                "</inertial>"
            )
        for geometry, place in part.shapes:
            origin = f'<origin xyz="{_numbers(place)}"/>'
            lines.append(f"<collision>{origin}<geometry>{geometry}</geometry></collision>")
        lines.append("</link>")
        if part.parent is not None:
            limit = "" if part.limit is None else f'lower="{part.limit[0]:.9g}" upper="{part.limit[1]:.9g}"'
            kind = "continuous" if part.kind == "revolute" and part.limit is None else part.kind
            follows = ""
            if part.mimic is not None:
                follows = f'<mimic joint="joint{part.mimic[0]}" multiplier="{part.mimic[1]:g}"/>'
            lines.append(
                f'<joint name="joint{index}" type="{kind}">'
                f'<parent link="link{part.parent}"/><child link="link{index}"/>'
                f'<origin xyz="{_numbers(part.at)}"/><axis xyz="{_numbers(part.axis)}"/>'
                f'<limit {limit} effort="9" velocity="9"/>{follows}</joint>'
            )
    return "\n".join([*lines, "</robot>"])


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
TURNS = (X, Y, Z)


def _chain(count: int, length: float, geometry: str, **options: Any) -> list[Part]:
    """Links in a row along x, which turn about the three axes in turn."""
    shapes = [(geometry, (0.5 * length, 0.0, 0.0))]
    parts = [Part(None, shapes=shapes, mass=options.get("mass", 1.0))]
    for index in range(1, count):
        parts.append(
            Part(
                index - 1, (length, 0.01 * length, 0.0), shapes, axis=TURNS[index % 3], centre=(0.4 * length, 0.0, 0.0),
                radius=0.3 * length, **options,
            )
        )  # fmt: skip
    return parts


def _legs(hip: float, foot: str, base: str, limit: tuple[float, float] | None, mass: float | None = 0.3) -> list[Part]:
    """A body with four legs of two links."""
    parts = [Part(None, shapes=[(base, (0.0, 0.0, 0.0))], mass=8.0, radius=0.15)]
    for side in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        upper = len(parts)
        place = (0.2 * side[0], hip * side[1], 0.0)
        parts.append(Part(0, place, [(cylinder(0.03, 0.2), (0.0, 0.0, -0.1))], axis=Y, limit=limit, mass=0.5))
        parts.append(Part(upper, (0.0, 0.0, -0.06), [(foot, (0.0, 0.0, 0.0))], axis=Y, mass=mass, radius=0.02))
    return parts


def _gripper(width: float, limits: Sequence[tuple[float, float]], follow: float | None) -> list[Part]:
    """A palm with two sliding fingers, one of which may follow the other."""
    finger = box(0.02, 0.02, 0.1)
    parts = [Part(None, shapes=[(box(0.1, 0.1, 0.04), (0.0, 0.0, 0.0))], mass=0.5)]
    for index, side in enumerate((1.0, -1.0)):
        slide = Part(
            0, (0.0, side * width, 0.03), [(finger, (0.0, 0.0, 0.03))], "prismatic", (0.0, side, 0.0), limits[index],
            0.05, 0.02, mimic=(1, follow) if index and follow is not None else None,
        )  # fmt: skip
        parts.append(slide)
    return parts


def _slot(gap: float, shift: float) -> list[Part]:
    """A link between two walls of the base that are nearer than it is thick: their normals are opposed."""
    walls = [(box(0.2, 0.02, 0.2), (0.1, side * (0.5 * gap + 0.01), shift * side)) for side in (1.0, -1.0)]
    return [
        Part(None, shapes=walls, mass=5.0),
        Part(0, (0.0, 0.0, 0.3), mass=0.1, axis=Y),
        Part(1, (0.0, 0.0, -0.3), [(box(0.1, 0.04, 0.1), (0.05, 0.0, 0.0))], mass=0.5, axis=X, centre=(0.05, 0, 0)),
    ]


SPHERES = [(sphere(0.06), (0.0, 0.0, 0.0))]
ROBOTS: dict[str, tuple[list[Part], str]] = {
    "links thicker than long": (_chain(6, 0.05, box(0.13, 0.08, 0.08)), "fixed"),
    "the same, floating": (_chain(6, 0.05, box(0.13, 0.08, 0.08)), "floating"),
    "cylinders across each other": (_chain(7, 0.04, cylinder(0.05, 0.1)), "fixed"),
    "spheres on hinges": (_chain(5, 0.08, sphere(0.085)), "fixed"),
    "hulls of meshes": (_chain(5, 0.06, mesh(0.15)), "fixed"),
    "grams": (_chain(6, 0.03, box(0.07, 0.05, 0.05), mass=0.001), "fixed"),
    "limits without zero": (_chain(7, 0.2, box(0.1, 0.02, 0.02), limit=(0.8, 2.5)), "fixed"),
    "limits of the other sign": (_chain(6, 0.2, box(0.1, 0.02, 0.02), limit=(-3.0, -2.0)), "floating"),
    "limits in degrees": (_chain(3, 0.1, box(0.05, 0.02, 0.02), limit=(10.0, 90.0)), "fixed"),
    "limits almost without room": (_chain(4, 0.1, box(0.05, 0.02, 0.02), limit=(0.4, 0.401)), "fixed"),
    "legs through the body": (_legs(0.05, sphere(0.03), box(0.5, 0.2, 0.1), None), "floating"),
    "legs bent the wrong way": (_legs(0.15, sphere(0.03), box(0.4, 0.2, 0.1), (1.0, 2.0)), "floating"),
    "feet without inertia": (_legs(0.05, sphere(0.04), box(0.5, 0.2, 0.1), (0.3, 0.9), None), "floating"),
    "fingers in each other": (_gripper(0.004, [(-0.01, 0.05), (-0.01, 0.05)], None), "fixed"),
    "fingers past their stops": (_gripper(0.03, [(0.02, 0.05), (0.02, 0.05)], None), "floating"),
    "fingers that follow against their stops": (_gripper(0.03, [(0.01, 0.05), (-0.05, -0.01)], 1.0), "fixed"),
    "between walls": (_slot(0.03, 0.0), "fixed"),
    "between shifted walls": (_slot(0.03, 0.002), "floating"),
    "a lever of a millimetre": (
        [
            Part(None, shapes=[(box(0.2, 0.2, 0.04), (0.0, 0.0, 0.0))]), Part(0, (0.0, 0.0, 0.3), mass=0.1, axis=X),
            Part(1, (0.001, 0.0, -0.27), [(sphere(0.03), (0.001, 0.0, 0.0))], mass=0.2, centre=(0.3, 0.0, 0.02)),
        ],
        "fixed",
    ),
    "a microgram under ten kilograms": (
        [
            Part(None, shapes=[(box(0.1, 0.1, 0.1), (0.0, 0.0, 0.0))], mass=10.0, radius=0.1),
            Part(0, (0.0, 0.0, -0.1), mass=1e-6, radius=0.01, axis=X),
            Part(1, (0.0, 0.0, 0.02), SPHERES, mass=1e-6, radius=0.01, axis=Y, limit=(0.5, 1.0)),
        ],
        "floating",
    ),
}  # fmt: skip
"""Parts by what is wrong with them, and the base."""


@st.composite
def wrong_robots(draw: st.DrawFn) -> tuple[list[Part], str]:
    """Trees of 2 to 8 links with shapes that may overlap, limits that may not hold, and links without inertia."""
    size = st.floats(0.2, 1.0)
    scale = 10.0 ** draw(st.floats(-1.7, -0.5))
    geometries = st.one_of(
        st.builds(lambda x, y, z: box(scale * x, scale * y, scale * z), size, size, size),
        st.builds(lambda r: sphere(0.5 * scale * r), size),
        st.builds(lambda r, h: cylinder(0.5 * scale * r, scale * h), size, size),
    )
    vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3)

    def place(share: float) -> list[float]:
        return [share * scale * value for value in draw(vectors)]

    parts = []
    for index in range(draw(st.integers(2, 8))):
        shapes = [(draw(geometries), place(0.3)) for _ in range(draw(st.integers(0, 2)))]
        kind = draw(st.sampled_from(["revolute", "revolute", "revolute", "prismatic"]))
        reach = 1.0 if kind == "prismatic" else 3.0
        stops = sorted(draw(st.tuples(st.floats(-reach, reach), st.floats(-reach, reach))))
        limit = (stops[0], stops[1] + 0.01) if kind == "prismatic" or draw(st.booleans()) else None
        if limit is not None and kind == "prismatic":
            limit = (scale * limit[0], scale * limit[1])
        inertial = index == 0 or draw(st.integers(0, 5)) > 0
        parts.append(
            Part(
                None if index == 0 else draw(st.integers(max(0, index - 2), index - 1)), place(1.0), shapes, kind,
                draw(st.sampled_from(TURNS)), limit, 10.0 ** draw(st.floats(-2.0, 1.0)) if inertial else None,
                scale * draw(st.floats(0.1, 0.6)), place(0.4),
            )
        )  # fmt: skip
    return parts, draw(st.sampled_from(["fixed", "floating"]))
