"""Shapes of a model as geoms of MJCF, and the pairs of them that can meet, each with the surface that the two have."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD, FrictionRule, Material, ModelError, ShapeType
from simwarp.exporters.mjcf_joints import text_of
from simwarp.exporters.mjcf_tree import Node, row_of
from simwarp.model.model import Model, meeting_pairs

Array = npt.NDArray[np.float64]

GEOMS: Final = {
    ShapeType.PLANE: "plane", ShapeType.SPHERE: "sphere", ShapeType.CAPSULE: "capsule",
    ShapeType.CYLINDER: "cylinder", ShapeType.BOX: "box", ShapeType.ELLIPSOID: "ellipsoid", ShapeType.HULL: "mesh",
    ShapeType.HEIGHT_FIELD: "hfield",
}  # fmt: skip
SIZES: Final = {
    ShapeType.SPHERE: 1, ShapeType.CAPSULE: 2, ShapeType.CYLINDER: 2, ShapeType.BOX: 3, ShapeType.ELLIPSOID: 3,
}  # fmt: skip
"""Numbers of a geom's size: ours have the same order."""
ROUND: Final = (ShapeType.SPHERE, ShapeType.CAPSULE)
"""Shapes that a margin only makes thicker."""
SPHERES_ONLY: Final = (ShapeType.SPROCKET, ShapeType.GROOVE)
"""Shapes that are left out."""
LEAST_RELIEF: Final = 1.0e-3
"""Height that stands for the relief of a level height field, which MJCF wants to be positive [m]."""
LEFT_OUT: Final = {
    "shape_restitution": "restitution: MuJoCo's contacts bounce by solref",
    "shape_cohesion": "cohesion",
    "shape_compliance": "compliance: MuJoCo's contacts are as soft as solref says",
}
"""Properties of surfaces that MJCF has not, where they are not 0."""


class ShapeWriter:
    """Writes the shapes of one world.

    Args:
        model: of them.
        world: whose parameters are written.
        assets: element that gets height fields and meshes.
        notes: get a line for each property that is left out.
    """

    def __init__(self, model: Model, world: int, assets: ElementTree.Element, notes: list[str]) -> None:
        self.model = model
        self._assets = assets
        self._notes = notes
        names = (
            "shape_x", "shape_rot", "shape_size", "shape_margin", "shape_asset", "shape_enabled", "shape_friction",
            "shape_rolling_friction", "shape_spinning_friction", *LEFT_OUT,
        )  # fmt: skip
        self._rows = {name: row_of(model, name, world) for name in names}

    @property
    def enabled_shapes(self) -> list[int]:
        """Shapes that are there."""
        return [index for index in range(self.model.shape_count) if self._rows["shape_enabled"][index]]

    def write(self, node: Node | None, element: ElementTree.Element) -> None:
        """Add the geoms of a body to its element; None: those of the world."""
        body = WORLD if node is None else node.body
        origin = np.zeros(3) if node is None else node.origin
        for index in self.enabled_shapes:
            if self.model.builder.shapes[index].body == body:
                self._write_geom(index, origin, element)

    def _write_geom(self, index: int, origin: Array, element: ElementTree.Element) -> None:
        shape, rows = self.model.builder.shapes[index], self._rows
        thing = f"MJCF: shape '{shape.name}'"
        if shape.type in SPHERES_ONLY:
            self._note(f"shape '{shape.name}': MJCF has no {shape.type.name.lower()}")
            return
        if shape.type not in GEOMS:
            raise ModelError(f"{thing}: a {shape.type.name} is not written; take a hull or another convex shape")
        if shape.type is ShapeType.PLANE and shape.body != WORLD:
            raise ModelError(f"{thing}: a plane must be on WORLD, got body '{self.model.body_names[shape.body]}'")
        place = np.array(rows["shape_x"][index], np.float64) - origin
        x, y, z, w = (float(value) for value in rows["shape_rot"][index])
        size = np.array(rows["shape_size"][index], np.float64)
        margin = float(rows["shape_margin"][index])
        geom = ElementTree.SubElement(element, "geom", name=shape.name, type=GEOMS[shape.type])
        normal = np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])
        if shape.type in SIZES:
            size[0] += margin if shape.type in ROUND else 0.0
            geom.set("size", text_of(size[: SIZES[shape.type]]))
        elif shape.type is ShapeType.PLANE:
            place = place + margin * normal
            geom.set("size", "0 0 1")  # without end
        elif shape.type is ShapeType.HULL:
            geom.set("mesh", shape.name)
            corners = self.model.builder.hulls[int(rows["shape_asset"][index])].vertices * size
            ElementTree.SubElement(self._assets, "mesh", name=shape.name, vertex=text_of(corners))
        else:
            geom.set("hfield", shape.name)
            place = place + (self._write_height_field(index, size) + margin) * normal
        if margin > 0.0 and shape.type not in (*ROUND, ShapeType.PLANE, ShapeType.HEIGHT_FIELD):
            self._note(f"margin of shape '{shape.name}'")
        geom.set("pos", text_of(place))
        geom.set("quat", text_of([w, x, y, z]))
        # pairs alone decide what meets
        geom.set("contype", "0")
        geom.set("conaffinity", "0")

    def _write_height_field(self, index: int, scale: Array) -> float:
        """Add the asset; returns the height of its lowest node [m], which is at 0 there."""
        shape = self.model.builder.shapes[index]
        field = self.model.builder.height_fields[int(self._rows["shape_asset"][index])]
        rows, columns = field.heights.shape
        half = 0.5 * np.array([columns - 1, rows - 1]) * field.spacing * scale[:2]
        heights = field.heights.astype(np.float64)
        lowest, highest = float(heights.min()) * scale[2], float(heights.max()) * scale[2]
        relief = highest - lowest if highest > lowest else LEAST_RELIEF
        ElementTree.SubElement(
            self._assets, "hfield", name=shape.name, nrow=str(rows), ncol=str(columns),
            # solid below, as ours; rows from the far side on, as an image
            size=text_of([*half, relief, half.max()]), elevation=text_of(heights[::-1] - heights.min()),
        )  # fmt: skip
        return lowest

    def write_pairs(self, element: ElementTree.Element) -> None:
        """Add the pairs of shapes that can meet."""
        shapes = self.model.builder.shapes
        shown = {index for index in self.enabled_shapes if shapes[index].type not in SPHERES_ONLY}
        for low, high in sorted(meeting_pairs(self.model.builder)):
            if low in shown and high in shown:
                slide, spin, roll = self._friction(low, high)
                dimensions = 6 if roll > 0.0 else 4 if spin > 0.0 else 3 if slide > 0.0 else 1
                ElementTree.SubElement(
                    element, "pair", geom1=shapes[low].name, geom2=shapes[high].name, condim=str(dimensions),
                    friction=text_of([slide, slide, spin, roll, roll]),
                )  # fmt: skip

    def _friction(self, low: int, high: int) -> tuple[float, float, float]:
        """Coefficient of sliding, levers of spinning and rolling [m] of a pair."""
        given = self.model.builder.given_pairs.get((low, high))
        if given is not None:
            self._note_given(given)
            return given.friction, given.spinning_friction, given.rolling_friction
        for name, text in LEFT_OUT.items():
            if self._rows[name][low] and self._rows[name][high]:
                self._note(text)
        slide, spin, roll = (
            combined(self.model, float(self._rows[name][low]), float(self._rows[name][high]), low, high, lever=lever)
            for name, lever in (
                ("shape_friction", False), ("shape_spinning_friction", True), ("shape_rolling_friction", True),
            )
        )  # fmt: skip
        return slide, spin, roll

    def _note_given(self, material: Material) -> None:
        for name, text in LEFT_OUT.items():
            if getattr(material, name.removeprefix("shape_")):
                self._note(text)

    def _note(self, text: str) -> None:
        if text not in self._notes:
            self._notes.append(text)


def combined(model: Model, first: float, second: float, low: int, high: int, *, lever: bool) -> float:
    """Friction of two shapes by priority or by the model's rule; see `Material`."""
    shapes, rule = model.builder.shapes, model.builder.friction_rule
    priorities = shapes[low].material.priority, shapes[high].material.priority
    if priorities[0] != priorities[1]:
        return first if priorities[0] > priorities[1] else second
    rules: Mapping[FrictionRule, Any] = {
        FrictionRule.MIN: min(first, second), FrictionRule.MAX: max(first, second),
        FrictionRule.MEAN: 0.5 * (first + second),
        FrictionRule.PRODUCT: min(first, second) if lever else first * second,
    }  # fmt: skip
    return float(rules[rule])
