"""Scene of cameras, lidars and radars: instances of shapes and meshes on bodies, over geometry shared by all worlds."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias, Unpack

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.array_devices import refuse_arguments_elsewhere
from simwarp.core.arrays import writable_from
from simwarp.core.constraints import Ge, Le, Meaning
from simwarp.core.object_repr import Names, Readable, Row, plural
from simwarp.core.types import WORLD, ModelError, Pose, ShapeType, Vec3, formatted, pose as make_pose
from simwarp.geometry.assets import TriangleMesh, triangle_mesh
from simwarp.geometry.triangle_tree import tree_tables
from simwarp.geometry.visual_mesh import VisualMesh
from simwarp.kernels.core.world_range import WorldRange
from simwarp.meshes.mesh_specification import FlexibleMesh
from simwarp.model.builder import ModelBuilder
from simwarp.model.checks import checked_names, checked_pose, index_within
from simwarp.model.model import Model
from simwarp.model.rules import RULES, held_fields, instance_of
from simwarp.model.shapes import checked_size, loaded_mesh, primitive_size
from simwarp.sensors.cameras.appearance import AppearanceList, Texture
from simwarp.sensors.deforming_surfaces import DeformingSurfaces
from simwarp.sensors.instances import Appearance, AppearanceOptions, Instance
from simwarp.sensors.interface import body_index
from simwarp.sensors.ray_hit_kernels import RayTarget
from simwarp.sensors.ray_instances_kernels import RayScene, place_instances
from simwarp.sensors.scene_arrays import hull_mesh, instance_values, no_targets, placed_arrays
from simwarp.sensors.soil_ground import ground_instance, soil_view
from simwarp.sensors.surface_values import color_by_values, white_look
from simwarp.simulation.attachments import StepContext
from simwarp.simulation.state import State
from simwarp.soil.soil_rays_kernels import SOIL_TARGET

if TYPE_CHECKING:
    from simwarp.soil.soil import Soil

ALL_GROUPS: Final = 0x7FFFFFFF
GroupBits: TypeAlias = Annotated[int, Ge(0), Le(ALL_GROUPS), Meaning("bits of groups below 2^31")]
PER_WORLD: Final = ("x", "rot", "size", "asset", "enabled", "color", "texture", "reflectance")
"""Arrays of a Scene that may differ by world."""


class Visuals(Readable):
    """Instances over a builder's world, before `finalize`. All its shapes are seen as they are, unless hidden; flexible
    meshes by their surfaces as they deform, and not by the spheres of their nodes.

    Args:
        builder: with its shapes; those that are added to it later are seen too, and come after what is there by then.
        spheres: flexible meshes are seen by the spheres of their nodes, which touch others, and not by their surfaces.

    Raises:
        ModelError: `builder` is no ModelBuilder; by its methods: a body, mesh or value is not usable.
    """

    @RULES.arguments("visuals")
    def __init__(
        self, builder: Annotated[ModelBuilder, instance_of(ModelBuilder, "pass the model's builder")], *,
        spheres: bool = False,
    ) -> None:  # fmt: skip
        self.builder = builder
        self._spheres = spheres
        self.meshes: list[TriangleMesh] = []
        self.mesh_visuals: list[VisualMesh | None] = []
        self.textures = AppearanceList()
        self.instances: list[Instance] = []
        self._followed = self._followed_meshes = 0
        self._follow()

    def _readable_title(self) -> str:
        return f": {plural(len(self.instances), 'instance')}, {plural(len(self.meshes), 'mesh')}"

    def _readable_rows(self) -> dict[str, Row]:
        return {"instances": Names(len(self.instances), (instance.name for instance in self.instances))}

    def texture(self, texture: Texture) -> int:
        """The number of a texture, for `Appearance.texture` and `Scene.texture`."""
        return self.textures.add(texture)

    def show(self, shape: int | FlexibleMesh, **appearance: Unpack[AppearanceOptions]) -> None:
        """Changes the appearance of a shape or a flexible mesh: fields of `Appearance`."""
        index = self.index_of(shape)
        instance = self.instances[index]
        self.instances[index] = dataclasses.replace(
            instance,
            appearance=dataclasses.replace(
                instance.appearance, **held_fields(f"visual '{instance.name}'", AppearanceOptions, appearance)
            ),
        )

    def show_values(self, mesh: FlexibleMesh) -> None:
        """Shows a flexible mesh in colours of values, such as stresses, that `Scene.set_values` gives; white at first.

        Raises:
            ModelError: it is not in sight.
        """
        index = self.index_of(mesh)
        white = dataclasses.replace(self.instances[index].appearance, color=(1.0, 1.0, 1.0))
        self.instances[index] = dataclasses.replace(self.instances[index], appearance=white, by_values=True)

    def hide(self, *shapes: int | FlexibleMesh) -> None:
        """No ray meets these shapes and flexible meshes. Indices of instances that were added before fall: hide first,
        then add.
        """
        gone = {self.index_of(shape) for shape in shapes}
        self.instances = [instance for index, instance in enumerate(self.instances) if index not in gone]

    def add_mesh(
        self, body: int, vertices: npt.ArrayLike | str | Path | VisualMesh, triangles: npt.ArrayLike | None = None, *,
        name: str | None = None, pose: Pose | None = None, scale: Vec3 = (1.0, 1.0, 1.0),
        **appearance: Unpack[AppearanceOptions],
    ) -> int:  # fmt: skip
        """Triangles (V, 3), (T, 3), or a file of them with its colours and textures, or a `VisualMesh`, on a body or
        WORLD; returns the instance. An appearance's colour multiplies the mesh's own, and is white unless given.
        """
        if isinstance(vertices, (str, Path, VisualMesh)):
            appearance.setdefault("color", (1.0, 1.0, 1.0))
        asset = self.add_mesh_asset(vertices, triangles)
        return self._add(ShapeType.MESH, body, scale, name, pose, appearance, asset)

    def add_mesh_asset(
        self, vertices: npt.ArrayLike | str | Path | VisualMesh, triangles: npt.ArrayLike | None = None
    ) -> int:
        """A mesh that no instance shows as built; returns its index for `Scene.asset` and `add_mesh_instance`.

        Args:
            vertices: (V, 3) [m]; or a file of a mesh, with its colours and textures; or a `VisualMesh`.
            triangles: (T, 3) indices of vertices; None for a file or a `VisualMesh`.

        Raises:
            ModelError: the arrays are no usable mesh, or the file cannot be read.
        """
        if isinstance(vertices, (str, Path)) and triangles is None:
            from simwarp.geometry.mesh_files import load_visual_mesh  # trimesh takes a while to import

            vertices = load_visual_mesh(vertices)
        mesh: VisualMesh | None = None
        points: npt.ArrayLike
        corners: npt.ArrayLike
        if isinstance(vertices, VisualMesh):
            mesh, points, corners = vertices, vertices.vertices, vertices.triangles
        else:
            points, corners = loaded_mesh(vertices, triangles)
        triangle_mesh(points, corners)  # for its checks: what is seen keeps its triangles as they are
        self.meshes.append(TriangleMesh(np.asarray(points, np.float32), np.asarray(corners, np.int32)))
        self.mesh_visuals.append(mesh)
        return len(self.meshes) - 1

    def add_mesh_instance(
        self, body: int, asset: int, *, name: str | None = None, pose: Pose | None = None,
        scale: Vec3 = (1.0, 1.0, 1.0),
        **appearance: Unpack[AppearanceOptions],
    ) -> int:  # fmt: skip
        """One more instance that shows a mesh of `add_mesh_asset`; returns its index.

        Args:
            body: index, or WORLD.
            asset: index that `add_mesh_asset` returned.
            name: of the instance.
            pose: on the body, from its centre of mass [m]; world axes on WORLD.
            scale: factors of the mesh along its axes.
            appearance: fields of `Appearance`.

        Raises:
            ModelError: there is no such mesh or body, or a value is not usable.
        """
        index_within(
            "visuals", f"asset must be in 0..{len(self.meshes) - 1}", asset, len(self.meshes), "see add_mesh_asset"
        )
        if self.mesh_visuals[asset] is not None:
            appearance.setdefault("color", (1.0, 1.0, 1.0))
        return self._add(ShapeType.MESH, body, scale, name, pose, appearance, asset)

    def add_box(
        self, body: int, *, half: Vec3, name: str | None = None, pose: Pose | None = None,
        **appearance: Unpack[AppearanceOptions],
    ) -> int:  # fmt: skip
        """A box of half lengths `half` [m]; returns the instance."""
        return self._add(ShapeType.BOX, body, half, name, pose, appearance)

    def add_sphere(
        self, body: int, *, radius: float, name: str | None = None, pose: Pose | None = None,
        **appearance: Unpack[AppearanceOptions],
    ) -> int:  # fmt: skip
        """A ball of a `radius` [m]; returns the instance."""
        return self._add(ShapeType.SPHERE, body, (radius,) * 3, name, pose, appearance)

    def add_ellipsoid(
        self, body: int, *, half: Vec3, name: str | None = None, pose: Pose | None = None,
        **appearance: Unpack[AppearanceOptions],
    ) -> int:  # fmt: skip
        """An ellipsoid of half axes `half` [m]; returns the instance."""
        return self._add(ShapeType.ELLIPSOID, body, half, name, pose, appearance)

    def add_cylinder(
        self, body: int, *, radius: float, half_length: float, name: str | None = None, pose: Pose | None = None,
        **appearance: Unpack[AppearanceOptions],
    ) -> int:  # fmt: skip
        """A cylinder about z, of a `radius` [m] and from -half_length to half_length [m]; returns the instance."""
        return self._add(ShapeType.CYLINDER, body, (radius, half_length, radius), name, pose, appearance)

    def add_capsule(
        self, body: int, *, radius: float, half_length: float, name: str | None = None, pose: Pose | None = None,
        **appearance: Unpack[AppearanceOptions],
    ) -> int:  # fmt: skip
        """A segment of z from -half_length to half_length [m], thickened by `radius` [m]; returns the instance."""
        return self._add(ShapeType.CAPSULE, body, (radius, half_length, radius), name, pose, appearance)

    def add_cone(
        self, body: int, *, radius: float, half_length: float, name: str | None = None, pose: Pose | None = None,
        **appearance: Unpack[AppearanceOptions],
    ) -> int:  # fmt: skip
        """A cone about z: its base of a `radius` [m] at -half_length, its tip at half_length [m]; returns its index."""
        return self._add(ShapeType.CONE, body, (radius, half_length, radius), name, pose, appearance)

    def add_primitive(
        self, body: int, kind: ShapeType, size: Sequence[float], *, name: str | None = None, pose: Pose | None = None,
        **appearance: Unpack[AppearanceOptions],
    ) -> int:  # fmt: skip
        """A box, sphere, ellipsoid, cylinder, capsule or cone by its kind, of three lengths as `ShapeType` tells [m];
        returns the instance.
        """
        return self._add(kind, body, primitive_size(kind, size), name, pose, appearance)

    def add_plane(
        self, *, name: str | None = None, pose: Pose | None = None, **appearance: Unpack[AppearanceOptions]
    ) -> int:
        """The endless plane z = 0 of its frame; returns the instance."""
        return self._add(ShapeType.PLANE, WORLD, (0.0, 0.0, 0.0), name, pose, appearance)

    @RULES.arguments("visuals")
    def finalize(
        self, model: Annotated[Model, instance_of(Model, "pass what builder.finalize returned")], *,
        per_world: Iterable[str] = (), origin_body: int | str | None = None,
    ) -> Scene:  # fmt: skip
        """The scene of a model that the same builder made; see `Scene`.

        Raises:
            ModelError: it was made by another builder, or before shapes or bodies were added.
        """
        self._follow()
        self._check_model(model)
        return Scene(self, model, per_world, origin_body)

    def index_of(self, shape: int | FlexibleMesh) -> int:
        """The instance that shows a shape or a flexible mesh of the model; those after a hidden one move up.

        Raises:
            ModelError: there is no such shape or mesh, or it is hidden.
        """
        self._follow()
        if isinstance(shape, FlexibleMesh):
            for index, instance in enumerate(self.instances):
                if instance.flexible >= 0 and self.builder.flexible_meshes[instance.flexible] is shape:
                    return index
            raise ModelError(
                f"visuals: there must be a mesh '{shape.name}' in sight; pass what add_solid_mesh returned"
            )
        for index, instance in enumerate(self.instances):
            if instance.shape == shape and shape >= 0:
                return index
        raise ModelError(
            f"visuals: there must be a shape {formatted(shape)} in sight; pass what add_shape_... returned"
        )

    def _follow(self) -> None:
        """Adds instances for shapes that the builder got since the last call."""
        names = {instance.name for instance in self.instances}
        given = {shape.name for shape in self.builder.shapes} | names
        meshes = self.builder.flexible_meshes
        nodes = set() if self._spheres else {shape for mesh in meshes for shape in mesh.shapes}
        for index, shape in enumerate(self.builder.shapes[self._followed :], start=self._followed):
            if index in nodes or shape.type is ShapeType.GROOVE:
                continue
            if shape.name in names:
                raise ModelError(
                    f"visual '{shape.name}': the name must be unique, got a shape of that name later; rename one"
                )
            # as wide as its teeth, a sprocket is seen as a cylinder; a groove is empty
            kind = ShapeType.CYLINDER if shape.type is ShapeType.SPROCKET else shape.type
            self.instances.append(
                Instance(shape.name, kind, shape.body, index, shape.pose, shape.size, shape.asset, Appearance())
            )
        self._followed = len(self.builder.shapes)
        if not self._spheres:
            for number in range(self._followed_meshes, len(meshes)):
                self.instances.append(_surface_instance(number, meshes[number], given))
        self._followed_meshes = len(meshes)

    def _check_model(self, model: Model) -> None:
        remedy = "finalize this builder after its last body and shape, and pass that model"
        for what, mine, theirs in (
            ("bodies", [body.name for body in self.builder.bodies], model.body_names),
            ("shapes", [shape.name for shape in self.builder.shapes], model.shape_names),
        ):
            if len(mine) != len(theirs):
                raise ModelError(
                    f"visuals: model must be made by the builder of these visuals, which has {len(mine)} {what}, "
                    f"got one with {len(theirs)}; {remedy}"
                )
            for name, other in zip(mine, theirs, strict=True):
                if name != other:
                    raise ModelError(
                        f"visuals: model must be made by the builder of these visuals, whose {what} include '{name}', "
                        f"got one with '{other}' there; {remedy}"
                    )

    def _add(
        self, kind: ShapeType, body: int, size: Vec3, name: str | None, pose: Pose | None,
        appearance: Mapping[str, Any], asset: int = -1,
    ) -> int:  # fmt: skip
        self._follow()
        title = name if name is not None else f"{kind.name.lower()}_{len(self.instances)}"
        thing = f"visual '{title}'"
        if any(instance.name == title for instance in self.instances):
            raise ModelError(f"{thing}: the name must be unique, got it twice; choose another")
        count = len(self.builder.bodies)
        rule, remedy = f"body must be WORLD or in 0..{count - 1}", "pass add_body's index"
        instance = Instance(
            title, kind, index_within(thing, rule, body, count, remedy, least=WORLD), -1, checked_pose(thing, pose),
            checked_size(thing, kind, size), asset, Appearance(**held_fields(thing, AppearanceOptions, appearance)),
        )  # fmt: skip
        self.instances.append(instance)
        return len(self.instances) - 1


def _surface_instance(number: int, mesh: FlexibleMesh, names: set[str]) -> Instance:
    """The instance that shows a flexible mesh; where something else has its name, it is "name (mesh)"."""
    title = f"{mesh.name} (mesh)" if mesh.name in names else mesh.name
    body = mesh.bodies[mesh.nodes[0]]
    return Instance(title, ShapeType.MESH, body, -1, make_pose(), np.ones(3), -1, Appearance(), number)


class Scene(Readable):
    """Instances that rays can hit, in all worlds. Geometry is stored once; worlds have poses, sizes and appearance.

    Args:
        visuals: the instances.
        model: finalized from the same builder.
        per_world: names of the arrays below that get a row per world.
        origin_body: the body about which float32 positions are relative; the first one when None, WORLD: none.

    Attributes:
        visuals: what it was made of.
        names: of the instances, in index order.
        x: (1 or W, I) vec3d position in the body's axes from its centre of mass [m]; world axes on WORLD.
        rot: (1 or W, I) quat xyzw.
        size: (1 or W, I) vec3, see `ShapeType` [m]; of a mesh its scale.
        asset: (1 or W, I) int32: which mesh of `Visuals.add_mesh_asset` an instance shows. A scene with flexible meshes
            has a row per world, where theirs is the number of the world.
        enabled: (1 or W, I) int32: 0 takes it out of sight.
        color: (1 or W, I) vec3 linear albedo.
        texture: (1 or W, I) int32, -1: none.
        reflectance: (1 or W, I).
        body, shape, label: (I,) NumPy.
        flexible: (I,) NumPy: number of the flexible mesh that an instance shows, -1: none.
        appearance: textures and visuals of meshes, for kernels.
        surfaces: those of flexible meshes; None: there are none.

    A shape of the model is placed by the model's arrays (`shape_x`, `shape_enabled`, ...): here only its appearance and
    `enabled` count.
    """

    x: wp.array
    rot: wp.array
    size: wp.array
    asset: wp.array
    enabled: wp.array
    color: wp.array
    texture: wp.array
    reflectance: wp.array

    def __init__(
        self, visuals: Visuals, model: Model, per_world: Iterable[str] = (), origin_body: int | str | None = None
    ) -> None:
        self.model, self.visuals = model, visuals
        instances = visuals.instances
        wanted = checked_names("scene", "per_world", per_world, PER_WORLD)
        self.names = tuple(instance.name for instance in instances)
        self.body = np.array([instance.body for instance in instances], np.int32)
        self.shape = np.array([instance.shape for instance in instances], np.int32)
        self.flexible = np.array([instance.flexible for instance in instances], np.int32)
        self.label = np.array([instance.appearance.label for instance in instances], np.int32)
        self.instance_count = len(instances)
        self._constants = _constants(visuals, model.device)
        self.surfaces = self._deforming()
        self.appearance = visuals.textures.tables(self._looks(), model.device)
        for instance in instances:
            _check_texture(visuals, instance)
        for name, (values, dtype) in instance_values(instances).items():
            shared = name not in wanted and not (name == "asset" and self.surfaces is not None)
            rows = np.repeat(values[None], 1 if shared else model.world_count, axis=0)
            if name == "asset" and self.surfaces is not None:
                rows[:, self.flexible >= 0] = np.arange(model.world_count)[:, None]
            setattr(self, name, writable_from(rows, dtype, model.device))
        self._placed = placed_arrays(len(instances), model.world_count, model.device)
        first = 0 if model.body_count else WORLD
        self.origin_body = first if origin_body is None else body_index("scene", origin_body, model)
        self._everyone = wp.full(model.world_count, 1, dtype=wp.int32, device=model.device)
        self._views: dict[str, Any] = {}

    def _readable_title(self) -> str:
        model = self.model
        return f": {plural(self.instance_count, 'instance')}, {plural(model.world_count, 'world')} on {model.device}"

    @property
    def world_parameters(self) -> dict[str, wp.array]:
        """What may differ by world, (1 or W, ...); each world keeps the surfaces of its own flexible bodies."""
        names = [name for name in PER_WORLD if name != "asset" or self.surfaces is None]
        return {f"scene_{name}": getattr(self, name) for name in names}

    def _readable_rows(self) -> dict[str, Row]:
        own = [name for name in PER_WORLD if getattr(self, name).shape[0] > 1]
        return {"instances": Names(len(self.names), self.names), "per world": Names(len(own), own)}

    def instance(self, name: str) -> int:
        """Index of an instance by name.

        Raises:
            ModelError: there is no such instance.
        """
        if name not in self.names:
            raise ModelError(f"scene: there is no instance '{name}'; known: {', '.join(self.names[:20])}")
        return self.names.index(name)

    def _deforming(self) -> DeformingSurfaces | None:
        """The surfaces of the flexible meshes that are seen, with their trees behind all others, or None."""
        shown = np.flatnonzero(self.flexible >= 0)
        if not len(shown):
            return None
        surfaces = DeformingSurfaces(self.model, self.flexible[shown].tolist(), self._constants["trees"])
        self._constants["trees"] = surfaces.trees
        trees = self._constants["tree"].numpy()
        trees[shown] = [surfaces.tree(index) for index in range(len(shown))]
        self._constants["tree"].assign(trees)
        return surfaces

    def _looks(self) -> list[VisualMesh | None]:
        """The look of every tree."""
        visuals = self.visuals
        plain = len(visuals.builder.hulls) + len(visuals.builder.meshes)
        flexible: list[VisualMesh | None] = []
        for instance in visuals.instances:
            if instance.flexible >= 0:
                mesh = visuals.builder.flexible_meshes[instance.flexible]
                flexible += [white_look(mesh) if instance.by_values else None] * self.model.world_count
        return [*([None] * plain), *visuals.mesh_visuals, *flexible]

    def set_values(self, mesh: FlexibleMesh, values: wp.array, *, most: float, least: float = 0.0) -> None:
        """Colours a flexible mesh in all worlds, from dark blue over green and yellow to red, until the next call.

        Args:
            mesh: one of `Visuals.show_values`.
            values: (W, E) float32 of its elements, as `sw.flex.mesh_stress` returns them, or (W, n) of its nodes.
            most: value of the last colour [unit of the values].
            least: value of the first colour [likewise].

        Raises:
            ModelError: the mesh is shown in one colour, or an argument is not usable.
        """
        index = self.visuals.index_of(mesh)
        if self.surfaces is None or not self.visuals.instances[index].by_values:
            raise ModelError(
                f"scene: values must be of a mesh that is shown by them, got '{mesh.name}'; call "
                "visuals.show_values(mesh) before finalize"
            )
        tree = int(self._constants["tree"].numpy()[index])
        color_by_values(mesh, tree, values, least, most, self.appearance, self.model.device)

    def cover_with(self, soil: Soil, ground: int | str | None = None) -> None:
        """Shows the ruts of a soil in the ground, darker where it is pressed down.

        Call it at any time, also after the sensors and the Simulation are made: their next frames have it.

        Args:
            soil: of the same model, on a plane or height field that the scene shows in the same place.
            ground: instance that shows the soil's undeformed ground; None: the only one of its kind on WORLD.

        Raises:
            ModelError: the soil is of another model or on a mesh; no or several instances are its ground; or a soil
                covers the scene already.
        """
        shapes = [each.kind for each in self.visuals.instances]
        instance = ground_instance(
            soil, ground, model=self.model, names=self.names, kinds=shapes, bodies=self.body
        )  # fmt: skip
        if SOIL_TARGET.name in self._views:
            raise ModelError("scene: cover_with takes one soil, got a second; give both vehicles' wheels to one Soil")
        self._replace(instance, SOIL_TARGET, soil_view(soil, instance, self._placed))

    def _replace(self, instance: int, target: RayTarget, view: Any) -> None:
        """Replaces an instance by a target of rays."""
        kinds = self._constants["kind"].numpy()
        kinds[instance] = target.kind
        self._constants["kind"].assign(kinds)
        self._views[target.name] = view  # of whose arrays the struct on the device has the addresses alone
        views = getattr(self._constants["targets"], target.name)
        wp.copy(views, wp.array([view], dtype=target.view, device=self.model.device))

    def tables(self, mask: int = ALL_GROUPS) -> RayScene:
        """The arrays as a struct for kernels; `mask`: bits of the groups that its rays meet."""
        scene = RayScene()
        scene.instance_count, scene.origin_body, scene.mask = self.instance_count, self.origin_body, mask
        for name, array in (*self._constants.items(), *self._placed.items()):
            setattr(scene, name, array)
        for name in PER_WORLD:
            setattr(scene, name, getattr(self, name))
        return scene

    def place(self, state: State, tables: RayScene, due: wp.array | None = None) -> None:
        """Moves the instances of the worlds that are due, (W,) int32, to their poses in the state, and deforms the
        surfaces of flexible meshes. Rays may follow.

        Raises:
            ModelError: an array lies on another device than the scene.
        """
        inputs = [WorldRange(), *self._place_inputs(state, due)]
        refuse_arguments_elsewhere(place_instances, [*inputs, tables], self.model.device)
        if self.surfaces is not None:
            self.surfaces.follow(state, self._everyone if due is None else due)
        wp.launch(
            place_instances, dim=self.model.world_count, device=self.model.device, inputs=inputs, outputs=[tables]
        )

    def record_place(self, simulation: StepContext, tables: RayScene, due: wp.array | None = None) -> list[Any]:
        """Records `place` as launches of a simulation, for the worlds that are due, (W,) int32."""
        inputs = self._place_inputs(simulation.state, due)
        place = simulation.shares.record(place_instances, inputs=inputs, outputs=[tables])
        if self.surfaces is None:
            return [place]
        return [*self.surfaces.record(simulation, self._everyone if due is None else due), place]

    def _place_inputs(self, state: State, due: wp.array | None) -> list[Any]:
        return [self._everyone if due is None else due, self.model.parameters, self.model.assets, state.arrays]


def _check_texture(visuals: Visuals, instance: Instance) -> None:
    """An instance's texture has to exist, and to have a mapping onto its surface."""
    thing, texture = f"visual '{instance.name}'", instance.appearance.texture
    if instance.flexible >= 0 and texture >= 0:
        raise ModelError(f"{thing}: a flexible mesh must have no texture, got {texture}; give it a colour alone")
    own = instance.kind == ShapeType.MESH and instance.shape < 0 and instance.flexible < 0
    visuals.textures.check(thing, texture, visuals.mesh_visuals[instance.asset] if own else None)


def _constants(visuals: Visuals, device: Any) -> dict[str, Any]:
    """Arrays (I,) of the instances, and the trees of all geometry: hulls, meshes of shapes, meshes of visuals."""
    builder, instances = visuals.builder, visuals.instances

    def ints(values: list[int]) -> wp.array:
        return wp.array(np.array(values or [-1], np.int32), dtype=wp.int32, device=device)

    hulls, meshes = len(builder.hulls), len(builder.meshes)

    def first_tree(instance: Instance) -> int:
        if instance.kind == ShapeType.MESH:
            return hulls if instance.shape >= 0 else hulls + meshes
        return 0

    geometry = [*(hull_mesh(hull) for hull in builder.hulls), *builder.meshes, *visuals.meshes]
    return {
        "kind": ints([int(instance.kind) for instance in instances]),
        "body": ints([instance.body for instance in instances]),
        "shape": ints([instance.shape for instance in instances]),
        "tree": ints([first_tree(instance) for instance in instances]),
        "group": ints([instance.appearance.group for instance in instances]),
        "label": ints([instance.appearance.label for instance in instances]),
        "trees": tree_tables(((mesh.vertices, mesh.triangles) for mesh in geometry), device),
        "targets": no_targets(device),
    }
