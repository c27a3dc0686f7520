"""Collision geometry of bodies: shapes, their materials and groups, as lists of a builder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Unpack

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import Meaning, Positive
from simwarp.core.rotation import rotate
from simwarp.core.types import (
    WORLD,
    FrictionRule,
    Material,
    ModelError,
    PairRule,
    Pose,
    ShapeType,
    Vec3,
    finite_vector,
    formatted,
    numbers,
    pose as make_pose,
)
from simwarp.geometry.assets import (
    HeightField,
    Hull,
    TriangleMesh,
    convex_hull,
    height_field,
    shape_mass,
    triangle_mesh,
)
from simwarp.geometry.sprocket_profiles import FEWEST_TEETH, MOST_TEETH, SprocketProfile, checked_profile
from simwarp.kernels.collision.narrow import can_meet
from simwarp.model.checks import (
    checked_flag,
    checked_member,
    checked_name,
    finite_number,
    index_within,
    positive_number,
    whole_number,
)
from simwarp.model.keyword_argument_types import ShapeOptions, SurfaceOptions
from simwarp.model.rules import ALL_GROUPS, RULES, Name, PoseField, held_fields
from simwarp.model.specifications import ShapeSpec

Array = npt.NDArray[np.float64]

TURNED: Final = (ShapeType.CAPSULE, ShapeType.CYLINDER, ShapeType.CONE)
"""Shapes of a radius and a half length."""
NOT_CONVEX: Final = (ShapeType.PLANE, ShapeType.HEIGHT_FIELD, ShapeType.MESH, ShapeType.SPROCKET, ShapeType.GROOVE)


class ShapeList:
    """The shapes of a builder and the pairs of them that can meet.

    Every `add_shape_...` takes the body (or WORLD), sizes in metres, and by keyword: `pose` of the shape's frame
    relative to the body's centre of mass in body axes (world axes on WORLD), `material`, `margin` by which the surface
    is thickened [m], `group` and `mask`: bits; two shapes meet if each one's group is in the other's mask.
    Returns the index of the shape slot.

    Attributes:
        friction_rule: how the frictions of two surfaces combine.
        pair_rule: how groups and masks decide which shapes meet.
    """

    def __init__(self) -> None:
        super().__init__()
        self.shapes: list[ShapeSpec] = []
        self.hulls: list[Hull] = []
        self.height_fields: list[HeightField] = []
        self.meshes: list[TriangleMesh] = []
        self.sprocket_profiles: list[SprocketProfile] = []
        self.excluded_bodies: set[tuple[int, int]] = set()
        self.excluded_shapes: set[tuple[int, int]] = set()
        self.given_pairs: dict[tuple[int, int], Material | None] = {}
        self.friction_rule = FrictionRule.MIN
        self.pair_rule = PairRule.BOTH

    def add_shape_plane(self, body: int = WORLD, **options: Unpack[ShapeOptions]) -> int:
        """The half-space below z = 0 of its frame."""
        return self._add_shape(ShapeType.PLANE, body, (0.0, 0.0, 0.0), options)

    def add_shape_sphere(self, body: int, *, radius: float, **options: Unpack[ShapeOptions]) -> int:
        """A ball of a `radius` [m]; returns the shape's index, as all `add_shape_...` do."""
        return self._add_shape(ShapeType.SPHERE, body, (radius, radius, radius), options)

    def add_shape_capsule(
        self, body: int, *, radius: float, half_length: float, **options: Unpack[ShapeOptions]
    ) -> int:
        """A segment of z from -half_length to half_length [m], thickened by `radius` [m]."""
        return self._add_shape(ShapeType.CAPSULE, body, (radius, half_length, radius), options)

    def add_shape_cylinder(
        self, body: int, *, radius: float, half_length: float, **options: Unpack[ShapeOptions]
    ) -> int:
        """A cylinder about z, of a `radius` [m] and from -half_length to half_length [m]."""
        return self._add_shape(ShapeType.CYLINDER, body, (radius, half_length, radius), options)

    def add_shape_box(self, body: int, *, half: Vec3, **options: Unpack[ShapeOptions]) -> int:
        """A box of half lengths `half` [m]."""
        return self._add_shape(ShapeType.BOX, body, half, options)

    def add_shape_ellipsoid(self, body: int, *, half: Vec3, **options: Unpack[ShapeOptions]) -> int:
        """An ellipsoid of half axes `half` [m]."""
        return self._add_shape(ShapeType.ELLIPSOID, body, half, options)

    def add_shape_cone(self, body: int, *, radius: float, half_length: float, **options: Unpack[ShapeOptions]) -> int:
        """A cone about z: its base, of a `radius` [m], at -half_length, its tip at half_length [m]."""
        return self._add_shape(ShapeType.CONE, body, (radius, half_length, radius), options)

    def add_shape_hull(
        self, body: int, points: npt.ArrayLike, *, scale: Vec3 = (1.0, 1.0, 1.0), **options: Unpack[ShapeOptions]
    ) -> int:
        """The convex hull of points (N, 3) [m], times `scale`. Equal points share one asset."""
        return self._add_shape(ShapeType.HULL, body, scale, options, self._hull_asset(points))

    def add_shape_height_field(
        self,
        body: int,
        heights: npt.ArrayLike,
        *,
        size: Sequence[float],
        scale: Vec3 = (1.0, 1.0, 1.0),
        **options: Unpack[ShapeOptions],
    ) -> int:
        """Terrain: heights (rows, columns) [m] above z = 0 of its frame, all times `scale`. Meets convex shapes only.

        Args:
            body: or WORLD.
            heights: (rows, columns) [m]; row j, column i is at x = -size_x/2 + i size_x/(columns - 1),
                y = -size_y/2 + j size_y/(rows - 1).
            size: extent along x and y [m], about the origin of its frame.
            scale: factors of x, y, z.
            options: see `ShapeOptions`.

        Returns:
            The index of the shape slot. Below the surface it is solid, down to half of its longer side under its
            lowest node; beyond the border there is nothing.
        """
        asset = self.add_height_field_asset(heights, size=size)
        return self._add_shape(ShapeType.HEIGHT_FIELD, body, scale, options, asset)

    def add_shape_mesh(
        self, body: int, vertices: npt.ArrayLike | str | Path, triangles: npt.ArrayLike | None = None, *,
        scale: Vec3 = (1.0, 1.0, 1.0), convex: bool = False, decompose: bool | dict[str, Any] = False,
        **options: Unpack[ShapeOptions],
    ) -> int | list[int]:  # fmt: skip
        """Triangles, times `scale`, that meet convex shapes only. They have one outer side, from which their corners
        are counter-clockwise; what touches them from the other side is taken to be sunk, and lifted out.

        Args:
            body: or WORLD.
            vertices: (V, 3) [m], or the path of an OBJ, STL, PLY or GLB file.
            triangles: (T, 3) vertex indices; None with a path.
            scale: factors of x, y, z.
            convex: take their convex hull instead, which meets everything.
            decompose: take several hulls instead (needs coacd or vhacdx; a dict holds its options).
            options: see `ShapeOptions`.

        Returns:
            The index of the shape slot; with `decompose` a list of them.

        Raises:
            ModelError: the mesh, its file or an option is not usable, or both `convex` and `decompose` are given.
        """
        checked_flag("add_shape_mesh", "convex", convex)
        if not isinstance(decompose, (bool, dict)):
            raise ModelError(
                f"add_shape_mesh: decompose must be True, False or a dict of options, "
                f"got {formatted(decompose)}; choose"
            )
        if convex and decompose is not False:
            raise ModelError("add_shape_mesh: give convex or decompose, got both; drop one")
        points, corners = loaded_mesh(vertices, triangles)
        if convex:
            return self.add_shape_hull(body, points, scale=scale, **options)
        if decompose is False:
            asset = self.add_mesh_asset(points, corners)
            return self._add_shape(ShapeType.MESH, body, scale, options, asset)
        from simwarp.geometry.mesh_files import convex_parts  # trimesh takes a while to import

        mesh = triangle_mesh(points, corners)
        try:
            parts = convex_parts(mesh.vertices, mesh.triangles, **(decompose if isinstance(decompose, dict) else {}))
        except TypeError as error:
            raise ModelError(f"add_shape_mesh: decompose has options that there are not: {error}; drop them") from None
        name = options.get("name", f"mesh{len(self.shapes)}")
        return [
            self._add_shape(
                ShapeType.HULL, body, scale, {**options, "name": f"{name}_{index}"}, self._hull_asset(part)
            )
            for index, part in enumerate(parts)
        ]  # fmt: skip

    def add_shape_sprocket(
        self, body: int, *, arc_center_radius: float, arc_radius: float, tip_radius: float, teeth: int,
        half_width: float, arc_offset: float = 0.0, **options: Unpack[ShapeOptions],
    ) -> int:  # fmt: skip
        """A sprocket about z: gaps that are concave arcs, the first on x. It meets spheres only: rollers of chains,
        those whose centres are within the half width as if they were in the middle plane. Each has one contact, with
        the nearest arc, where that lies below the tips; the ends of the teeth have none.

        Args:
            body: or WORLD.
            arc_center_radius: of the circle on which the centres of the arcs lie [m].
            arc_radius: of the arcs [m]; spheres that it can meet must be smaller.
            tip_radius: of the teeth [m].
            teeth: how many.
            half_width: along z [m].
            arc_offset: angle [rad] from the middle of a gap to either of its two arcs; 0: it has one.
            options: see `ShapeOptions`.

        Raises:
            ModelError: arcs that do not reach below the tips, or that leave no teeth, or a value is not usable.
        """
        thing = self._shape_title(ShapeType.SPROCKET, options)
        lengths = {"arc_center_radius": arc_center_radius, "arc_radius": arc_radius, "tip_radius": tip_radius}
        for field, value in lengths.items():
            positive_number(thing, field, value, "m", "it is a radius")
        positive_number(thing, "half_width", half_width, "m", "it is half the width")
        count = whole_number(thing, "teeth", teeth, FEWEST_TEETH, MOST_TEETH, "count its gaps")
        offset = finite_number(thing, "arc_offset", arc_offset, "pass an angle")
        profile = SprocketProfile(count, arc_center_radius / tip_radius, arc_radius / tip_radius, offset)
        checked_profile(thing, profile)
        if profile not in self.sprocket_profiles:
            self.sprocket_profiles.append(profile)
        size, asset = (tip_radius, half_width, tip_radius), self.sprocket_profiles.index(profile)
        return self._add_shape(ShapeType.SPROCKET, body, size, options, asset)

    def add_shape_groove(
        self, body: int, *, radius: float, half_width: float, **options: Unpack[ShapeOptions]
    ) -> int:  # fmt: skip
        """The room between two discs about z, which keeps spheres in: the guides of a chain. It meets spheres only, as
        long as their centres are within the discs' radius; it has one contact, with the nearer disc.

        Args:
            body: or WORLD.
            radius: of the discs [m].
            half_width: half of their distance [m]; spheres that it can meet must be smaller.
            options: see `ShapeOptions`.
        """
        thing = self._shape_title(ShapeType.GROOVE, options)
        positive_number(thing, "radius", radius, "m", "it is that of the discs")
        positive_number(thing, "half_width", half_width, "m", "it is half the discs' distance")
        return self._add_shape(ShapeType.GROOVE, body, (radius, half_width, radius), options)

    def add_shape_primitive(
        self, body: int, kind: ShapeType | str, size: Vec3 | Sequence[float], **options: Unpack[ShapeOptions]
    ) -> int:
        """A shape without an asset, by its kind: a plane, sphere, capsule, cylinder, box, ellipsoid or cone.

        Args:
            body: or WORLD.
            kind: of the shape.
            size: three lengths as `ShapeType` tells [m]; those that the kind has not do not count.
            options: see `ShapeOptions`.

        Raises:
            ModelError: the kind needs an asset, or a value is not usable.
        """
        known = checked_member("shape", "kind", kind, ShapeType)
        return self._add_shape(known, body, primitive_size(known, size), options)

    def add_hull_asset(self, points: npt.ArrayLike) -> int:
        """A hull of points (N, 3) [m] that no shape shows as built: index for `Model.shape_asset` of HULL shapes.

        Equal ones share it.

        Raises:
            ModelError: the points have no hull.
        """
        return self._hull_asset(points)

    def add_height_field_asset(self, heights: npt.ArrayLike, *, size: Sequence[float]) -> int:
        """A height field that no shape shows as built: index for `Model.shape_asset` of HEIGHT_FIELD shapes.

        Equal ones share it.

        Args:
            heights: (rows, columns) [m], columns along x, rows along y.
            size: extent along x and y [m].

        Raises:
            ModelError: the heights or the size are not usable.
        """
        field = height_field(heights, size)
        for index, other in enumerate(self.height_fields):
            if field.spacing == other.spacing and np.array_equal(field.heights, other.heights):
                return index
        self.height_fields.append(field)
        return len(self.height_fields) - 1

    def add_mesh_asset(self, vertices: npt.ArrayLike | str | Path, triangles: npt.ArrayLike | None = None) -> int:
        """A mesh that no shape shows as built: index for `Model.shape_asset` of MESH shapes.

        Equal ones share it.

        Args:
            vertices: (V, 3) [m], or the path of an OBJ, STL, PLY or GLB file.
            triangles: (T, 3) vertex indices; None with a path.

        Raises:
            ModelError: the arrays are no usable mesh, or the file cannot be read.
        """
        mesh = triangle_mesh(*loaded_mesh(vertices, triangles))
        for index, other in enumerate(self.meshes):
            if np.array_equal(mesh.vertices, other.vertices) and np.array_equal(mesh.triangles, other.triangles):
                return index
        self.meshes.append(mesh)
        return len(self.meshes) - 1

    @RULES.arguments("solid '{name}'")
    def add_solid(
        self, name: Name, kind: ShapeType | str, size: Vec3 | float | None = None, *,
        mass: Annotated[Positive, Meaning("kilograms, or give density instead")] | None = None,
        density: Annotated[Positive, Meaning("kg/m³, or give mass instead")] | None = None,
        points: npt.ArrayLike | None = None, pose: PoseField = None,
        velocity: Vec3 = (0.0, 0.0, 0.0), omega: Vec3 = (0.0, 0.0, 0.0), **options: Unpack[SurfaceOptions],
    ) -> int:  # fmt: skip
        """A homogeneous body and its shape in one; returns the body's index.

        Args:
            name: of both.
            kind: a convex `ShapeType` or its name ("box").
            size: as `ShapeType` tells: half lengths (one number for three equal ones), radius of a sphere, or radius
                and half length [m]; of a hull its scale (1 when None).
            mass: [kg]; or
            density: [kg/m³].
            points: (N, 3) of a hull [m].
            pose: of the shape's frame in the world: the centre of mass follows from the geometry.
            velocity: of the centre of mass [m/s], world frame.
            omega: [rad/s], world frame.
            options: `material`, `margin`, `group`, `mask` of the shape.

        Raises:
            ModelError: both or none of `mass` and `density` are given, or another value is not usable.
        """
        thing = f"solid '{name}'"
        shape_type = checked_kind(thing, kind)
        asset = self._hull_asset(points) if shape_type == ShapeType.HULL and points is not None else -1
        if size is None:
            size = (1.0, 1.0, 1.0) if shape_type == ShapeType.HULL else ()
        values = numbers(size)
        if values.shape == () and shape_type in TURNED:
            raise ModelError(f"{thing}: size must be radius and half length [m], got {formatted(size)}; give both")
        if values.shape == () or (values.shape == (2,) and shape_type in TURNED):
            values = values.reshape(-1)[[0, -1, 0]]
        extent = checked_size(thing, shape_type, values)
        if (mass is None) == (density is None):
            raise ModelError(
                f"{thing}: give mass or density, got mass={formatted(mass)}, density={formatted(density)}; drop one"
            )
        solid = shape_mass(shape_type, extent.tolist(), 1.0, self.hulls[asset] if asset >= 0 else None)
        weight = mass or (density or 0.0) * solid.mass
        frame = pose or make_pose()
        offset = {"name": name, "pose": make_pose(-solid.centre)}
        shape = self._shape_spec(shape_type, self.body_total, extent, {**offset, **options}, asset)
        body = self.add_body(
            name, mass=weight, inertia=solid.inertia * (weight / solid.mass), velocity=velocity, omega=omega,
            pose=make_pose(frame.position + rotate(frame.rotation, solid.centre), frame.rotation),
        )  # fmt: skip
        self.shapes.append(shape)
        return body

    def add_body(
        self, name: str, *, mass: float, inertia: Any, pose: Pose | None = None, velocity: Vec3 = (0.0, 0.0, 0.0),
        omega: Vec3 = (0.0, 0.0, 0.0),
    ) -> int:  # fmt: skip
        """See `ModelBuilder.add_body`."""
        raise NotImplementedError

    def _hull_asset(self, points: npt.ArrayLike) -> int:
        """Index of the hull of these points."""
        hull = convex_hull(points)
        for index, other in enumerate(self.hulls):
            if np.array_equal(hull.vertices, other.vertices):
                return index
        self.hulls.append(hull)
        return len(self.hulls) - 1

    def exclude_collision(self, body0: int, body1: int) -> None:
        """Shapes of these two bodies never meet. Bodies that a joint ties together do not meet anyway."""
        for body in (body0, body1):
            self._check_body("exclude_collision", body)
        self.excluded_bodies.add((min(body0, body1), max(body0, body1)))

    def exclude_shapes(self, shape0: int, shape1: int) -> None:
        """These two shapes never meet; others of their bodies may.

        Raises:
            ModelError: there is no such shape, both are one, or they were given to `add_shape_pair`.
        """
        pair = self._shape_pair("exclude_shapes", shape0, shape1)
        if pair in self.given_pairs:
            raise ModelError(f"exclude_shapes: {self._named(pair)} were given to add_shape_pair, got both; drop one")
        self.excluded_shapes.add(pair)

    def add_shape_pair(self, shape0: int, shape1: int, *, material: Material | None = None) -> None:
        """These two shapes may meet, whatever groups, masks, joints and `exclude_collision` say.

        Args:
            shape0: index of a shape slot.
            shape1: that of another one, on another body.
            material: surface of their contact, in place of what their own make of it; Young's modulus and Poisson's
                ratio stay theirs.

        Raises:
            ModelError: they are on one body, of kinds that never meet, were excluded, or a value is not usable.
        """
        pair = self._shape_pair("add_shape_pair", shape0, shape1)
        shapes = [self.shapes[index] for index in pair]
        if shapes[0].body == shapes[1].body:
            raise ModelError(f"add_shape_pair: shapes must be on two bodies, got {self._named(pair)} on one; drop it")
        if not kinds_meet(shapes[0].type, shapes[1].type):
            raise ModelError(
                f"add_shape_pair: sprockets and grooves meet spheres only, got {self._named(pair)}; take a sphere"
            )
        if all(shape.type in NOT_CONVEX for shape in shapes):
            raise ModelError(
                f"add_shape_pair: one shape must be convex, got {self._named(pair)}; take hulls (convex, decompose)"
            )
        if pair in self.excluded_shapes:
            raise ModelError(f"add_shape_pair: {self._named(pair)} were excluded by exclude_shapes, got both; drop one")
        held_fields("add_shape_pair", SurfaceOptions, {"material": material})
        self.given_pairs[pair] = None if material is None else checked_material("add_shape_pair", material)

    def _shape_pair(self, thing: str, shape0: int, shape1: int) -> tuple[int, int]:
        """Two different shapes, the smaller index first."""
        for field, shape in (("shape0", shape0), ("shape1", shape1)):
            whole_number(thing, field, shape, 0, len(self.shapes) - 1, "pass what add_shape_... returned")
        if shape0 == shape1:
            raise ModelError(
                f"{thing}: shape0 and shape1 must differ, got {formatted(shape0)} for both; name two shapes"
            )
        return int(min(shape0, shape1)), int(max(shape0, shape1))

    def _named(self, pair: tuple[int, int]) -> str:
        return " and ".join(f"'{self.shapes[index].name}'" for index in pair)

    @property
    def body_total(self) -> int:
        """Bodies added so far."""
        raise NotImplementedError

    def _check_body(self, thing: str, body: int) -> None:
        rule = f"body must be WORLD or in 0..{self.body_total - 1}"
        index_within(thing, rule, body, self.body_total, "pass what add_body returned", least=WORLD)

    def _add_shape(
        self, kind: ShapeType, body: int, size: Vec3 | Sequence[float], options: Mapping[str, Any], asset: int = -1
    ) -> int:
        self._check_body(self._shape_title(kind, options), body)
        self.shapes.append(self._shape_spec(kind, body, size, options, asset))
        return len(self.shapes) - 1

    def _shape_title(self, kind: ShapeType, options: Mapping[str, Any]) -> str:
        """How errors call the next shape."""
        return checked_name("shape", options.get("name", f"{kind.name.lower()}{len(self.shapes)}"))

    def _shape_spec(
        self, kind: ShapeType, body: int, size: Vec3 | Sequence[float], options: Mapping[str, Any], asset: int
    ) -> ShapeSpec:
        """The shape, checked but not added."""
        name = options.get("name", f"{kind.name.lower()}{len(self.shapes)}")
        thing = checked_name("shape", name)
        if any(shape.name == name for shape in self.shapes):
            raise ModelError(f"{thing}: the name must be unique, got it twice; choose another")
        given = {"pose": None, "material": None, "margin": 0.0, "group": 1, "mask": ALL_GROUPS, **options}
        held = held_fields(thing, ShapeOptions, given)
        material = checked_material(thing, held["material"] or Material())
        return ShapeSpec(
            name, int(body), kind, held["pose"], checked_size(thing, kind, size), material, held["margin"],
            held["group"], held["mask"], asset,
        )  # fmt: skip


def loaded_mesh(
    vertices: npt.ArrayLike | str | Path, triangles: npt.ArrayLike | None
) -> tuple[npt.ArrayLike, npt.ArrayLike]:
    """Vertices and triangles, from a file where a path is given."""
    if isinstance(vertices, (str, Path)):
        if triangles is not None:
            raise ModelError("mesh: vertices name a file, which has its own triangles, got both; leave triangles out")
        from simwarp.geometry.mesh_files import load_mesh  # trimesh takes a while to import

        return load_mesh(vertices)
    if triangles is None:
        raise ModelError("mesh: triangles must be given with vertices, got None; pass (T, 3) indices or a path")
    return vertices, triangles


def checked_kind(thing: str, kind: ShapeType | str) -> ShapeType:
    """A convex shape type, from itself or its name."""
    convex = [member for member in ShapeType if member not in NOT_CONVEX]
    if isinstance(kind, ShapeType) and kind in convex:
        return kind
    for member in convex:
        if isinstance(kind, str) and kind.upper() == member.name:
            return member
    names = ", ".join(member.name.lower() for member in convex)
    raise ModelError(
        f"{thing}: kind must be one of {names}, got {formatted(kind)}; other shapes go on a body with add_shape_..."
    )


def primitive_size(kind: ShapeType, size: Vec3 | Sequence[float]) -> Vec3:
    """The size of a shape without an asset, as `ShapeType` tells, from three lengths of which some do not count.

    Raises:
        ModelError: the kind needs an asset.
    """
    a, b, c = finite_vector("shape", "size", size, 3).tolist()
    sizes = {
        ShapeType.PLANE: (0.0, 0.0, 0.0), ShapeType.SPHERE: (a, a, a), **dict.fromkeys(TURNED, (a, b, a)),
        **dict.fromkeys((ShapeType.BOX, ShapeType.ELLIPSOID), (a, b, c)),
    }  # fmt: skip
    if kind not in sizes:
        raise ModelError(f"shape: kind must be that of a primitive, got {kind.name}; use add_shape_... of its own")
    return sizes[kind]


def checked_size(thing: str, kind: ShapeType, size: Vec3 | Sequence[float]) -> Array:
    """Three finite numbers, positive where the kind needs them."""
    values = finite_vector(thing, "size", size, 3)
    if kind in (ShapeType.HULL, ShapeType.HEIGHT_FIELD, ShapeType.MESH):
        for value in values.tolist():
            positive_number(thing, "scale", value, "along every axis", "mirror the geometry itself")
    elif kind != ShapeType.PLANE:
        for value in values:
            positive_number(thing, "every size (radius, half_length, half)", value, "m", "sizes are half lengths")
    return values


def checked_material(thing: str, material: Material) -> Material:
    """The material, with every field in its range."""
    held_fields(thing, Material, vars(material), "material.")
    return material


def on_host(function: Any) -> Any:
    """A device function as Python runs it."""
    return function.func


def kinds_meet(a: ShapeType, b: ShapeType) -> bool:
    """False for kinds of shapes that never have contacts: sprockets and grooves with all but spheres."""
    return bool(on_host(can_meet)(min(a, b), max(a, b)))
