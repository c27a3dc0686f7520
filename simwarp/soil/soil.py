"""Deformable ground as a force element: wheels and other shapes leave ruts in it, which later ones meet."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.array_devices import array_from_host, array_on
from simwarp.core.arrays import with_zeros, writable, writable_from
from simwarp.core.constraints import Parsed, RuleError
from simwarp.core.object_repr import Row, plural
from simwarp.core.types import FLOAT32_LEAST, ModelError, ShapeType, formatted, number, numbers
from simwarp.kernels.collision.shape import HEIGHT_FIELD, PLANE
from simwarp.model.checks import whole_number
from simwarp.model.model import Model
from simwarp.model.rules import RULES, Flag, instance_of, word_of
from simwarp.simulation.attachments import ForceElement, StepContext
from simwarp.simulation.world_launches import WorldLaunch
from simwarp.simulation.world_masks import mask_of_worlds
from simwarp.soil.blades import Blades
from simwarp.soil.bulldozing import Bulldozing, SoilFlow
from simwarp.soil.deformed_surface_kernels import SoilCover, find_heights
from simwarp.soil.pressing_kernels import carry_bodies, claim_pages, clear_soil, press_shapes, report_shapes
from simwarp.soil.sheet_pressing_kernels import press_sheets, report_sheets, survey_sheets
from simwarp.soil.soil_columns_kernels import PARAMETERS, SIDE
from simwarp.soil.soil_parameters import SoilSpec, soils_of
from simwarp.soil.soil_shapes import (
    SoilBlade,
    SoilShape,
    SoilWheel,
    carriers_of,
    checked_shapes,
    narrowest_width,
    pages_at_a_time,
    shape_tables,
    share_bodies,
)
from simwarp.soil.soil_sheets import SoilMesh, checked_meshes, pages_below, sheet_tables
from simwarp.soil.soil_tables_kernels import NODE_VALUES, PAGE_NODES, SoilNodes, SoilReports, SoilTables
from simwarp.soil.static_sinkage_kernels import find_resting_shifts, imprint_worlds, keep_forces
from simwarp.vehicle.tires.ground_kernels import TerrainTables
from simwarp.vehicle.tires.tires import ground as plane, ground_rows

MOST_PAGES: Final = 1 << 20
STEEPEST: Final = math.radians(45.0)
"""Of a plane: nodes lie in columns seen from above, fewer and fewer on what leans more."""


def checked_pages(pages: Any, spacing: float, least: int) -> int:
    """Pages of a world: at least those below all shapes at once.

    Args:
        pages: as given.
        spacing: of the nodes [m].
        least: pages that all shapes may lie on together (`pages_at_a_time`).

    Raises:
        ModelError: they are too few or no whole number.
    """
    if least > MOST_PAGES:
        most = f"at most {MOST_PAGES} pages may lie below the shapes"
        raise ModelError(f"soil: spacing must be so wide that {most}, got {spacing:.4g} m, {least}; 0.05 suits cars")
    remedy = f"so many of {spacing * SIDE:.3g} m may lie below the shapes; raise it, or the spacing"
    return whole_number("soil", "pages", pages, least, MOST_PAGES, remedy)


def _tables(ground: Any) -> Any:
    if getattr(ground, "_cls", None) is not TerrainTables:
        raise RuleError("of simwarp.vehicle.tires.ground", "make it by that")
    return ground


GROUND: Final = Parsed(_tables)
"""A ground that `simwarp.vehicle.tires.ground` made."""


def check_ground(ground: Any) -> None:
    """Refuses a plane that leans by more than 45 degrees."""
    if ground.kind != PLANE:
        return
    upright = float(ground.rot.numpy()[:, 2, 2].min())
    if not upright >= math.cos(STEEPEST) - 1e-6:
        lean = math.degrees(math.acos(max(-1.0, min(1.0, upright))))
        raise ModelError(f"soil: ground must lean by at most 45 degrees, got {lean:.4g}; turn it, or gravity")


def checked_map(soil_map: Any, soils: int, worlds: int) -> npt.NDArray[np.int32]:
    """Indices of soils, (1 or W, rows, columns); without cells where there is no map.

    Raises:
        ModelError: it has another shape, or holds anything but indices of soils.
    """
    if soil_map is None:
        return np.zeros((1, 0, 0), np.int32)
    values = numbers(soil_map)
    values = values[None] if values.ndim == 2 else values
    if values.ndim != 3 or values.shape[0] not in (1, worlds) or not values.size:
        got = values.shape if values.ndim else formatted(soil_map)
        raise ModelError(
            f"soil: soil_map must be (rows, columns) or ({worlds}, rows, columns), got {got}; it has numbers of soils"
        )
    wrong = values[~((values >= 0.0) & (values < soils) & (values == np.floor(values)))]
    if len(wrong):
        raise ModelError(f"soil: soil_map must hold indices below {soils}, got {wrong[0]:g}; name more soils")
    return values.astype(np.int32)


def check_map(
    shape: tuple[int, ...], origin: tuple[float, float], cell: tuple[float, float], ground: TerrainTables, model: Model
) -> None:
    """Refuses cells without a size, and a map that leaves a part of a height field out.

    Args:
        shape: of the map, (..., rows, columns); without cells it is none.
        origin: corner of the first cell [m].
        cell: size of the cells [m].
        ground: below the soil.
        model: with the height fields.
    """
    for name, pair, least in (("map_origin", origin, -math.inf), ("map_cell", cell, 0.0)):
        given = numbers(pair)
        if given.shape != (2,) or not (np.isfinite(given) & (given > least)).all():
            rule = "finite" if least < 0.0 else "finite and > 0 m"
            raise ModelError(
                f"soil: {name} must be two numbers, {rule}, got {formatted(pair)}; it has one of x and one of y"
            )
    if shape[-1] == 0 or ground.kind != HEIGHT_FIELD:
        return
    low, high = _field_bounds(ground, model)
    last = np.array(origin) + np.array(cell) * (shape[-1], shape[-2])
    if (low < np.array(origin) - 1e-6).any() or (high > last + 1e-6).any():
        extents = [f"x {a[0]:.4g} to {b[0]:.4g}, y {a[1]:.4g} to {b[1]:.4g}" for a, b in ((low, high), (origin, last))]
        remedy = "set map_origin and map_cell"
        raise ModelError(f"soil: soil_map must cover the ground, {extents[0]} m, got {extents[1]}; {remedy}")


def _field_bounds(ground: TerrainTables, model: Model) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Least and greatest x and y of the height fields of all worlds [m]."""
    nodes, spacing = model.assets.field_nodes.numpy(), model.assets.field_spacing.numpy()
    tables = [ground.asset.numpy(), ground.x.numpy(), ground.rot.numpy(), ground.scale.numpy()]
    corners = []
    for world in range(max(len(table) for table in tables)):
        asset, x, rot, scale = (table[world % len(table)] for table in tables)
        half = 0.5 * (nodes[asset] - 1) * spacing[asset] * scale[:2]
        corners += [x[:2] + rot[:2, :2] @ (half * sign) for sign in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    return np.min(corners, axis=0), np.max(corners, axis=0)


USUAL_SPACING: Final = 0.05
"""Of the nodes below a car [m]."""
DIRECTION_LENGTH: Final = 1.0e-3
"""Over which the direction of shear relaxes [m]."""
REST_TIME: Final = 10.0 * DIRECTION_LENGTH
"""Displacement that holds a node at rest, per speed [s]: ten lengths per 1 m/s."""
REST_SPEED: Final = 0.02
"""Above which a node slides [m/s]."""


class ShearMemory(enum.Enum):
    """What a node remembers of shear."""

    DIRECTION = "direction"
    """How far it was sheared, and a direction that follows the slip: still at rest, holds on slopes."""
    SCALAR = "scalar"
    """How far alone, as in Chrono: the force is against the slip of the moment."""


SHEAR_MEMORIES: Final = tuple(memory.value for memory in ShearMemory)


class PressureNormal(enum.Enum):
    """The normal along which soil presses on a rigid shape."""

    GROUND = "ground"
    """Of the undeformed ground, as in Chrono: on level ground nothing pushes back, and what a wheel compacts is in its
    torque alone."""
    SURFACE = "surface"
    """Of the shape, as in Bekker's and Wong's theory of rigid wheels: compaction resists the motion."""


PRESSURE_NORMALS: Final = tuple(normal.value for normal in PressureNormal)


class Soil(ForceElement):
    """Deformable ground: pressure after Bekker, shear after Janosi, in nodes of a regular grid.

    Only nodes that a shape has touched use memory, in pages of 8 x 8. When a world has used up its pages, it recycles
    the one that was touched longest ago, and loses the ruts in it (`recycled` counts).

    Args:
        model: of the worlds.
        shapes: what sinks in: `SoilWheel`, `SoilBox`, `SoilSphere`, `SoilCapsule`, `SoilCylinder`, several on one body
            too, see `soil_shapes`; and `SoilBlade`, which cuts.
        soil: a `SoilSpec`, the name of a preset (soft, mid, hard, clay, snow, sand), or several of them for `soil_map`.
        ground: the undeformed ground (`simwarp.vehicle.tires.ground`); the plane z = 0 when None.
        spacing: of the nodes [m].
        pages: of each world, 8 x 8 nodes (1.3 KiB) each.
        shear_memory: what nodes remember of shear.
        pressure_normal: along which nodes press on rigid shapes; on meshes it is the ground's.
        weighted: nodes count by the share of their cell that lies inside a wheel's width, or below a box.
        bulldozing: how soil that is pressed down rises beside shapes; None: it does not.
        soil_map: (rows along y, columns along x) indices of soils, or (W, rows, columns); None: the first everywhere.
        map_origin, map_cell: corner of its first cell, and its cells' size [m].
        wheels: further shapes, after `shapes`.
        meshes: flexible ones whose surfaces sink in; in the outputs they come after all shapes.

    Attributes:
        parameter: (1 or W, soils, 9) of `SoilSpec.values`; write it where worlds differ (`per_world`).
        load, sinkage, slip_ratio: (W, shapes) vertical force [N], depth of the rut below the shape's centre [m], slip
            of wheels.
        force_w, torque_w: (W, shapes) vec3 on the shape, at its centre, world axes [N, N·m].
        touched: (W, shapes) nodes with pressure.
        recycled: (W,) pages that were recycled.
        rest_force_b, rest_torque_b: (W, shapes) vec3 that `imprint` makes the soil carry, at the shape's centre, axes
            of its body [N, N·m]; no force: what fresh soil bears there. `keep_forces` writes them.

    Raises:
        ModelError: a value breaks its rule.
    """

    implicit = True

    @RULES.arguments("soil")
    def __init__(
        self, model: Model, shapes: Sequence[SoilShape] = (),
        soil: SoilSpec | str | Sequence[SoilSpec | str] = "mid", *,
        ground: Annotated[TerrainTables, GROUND] | None = None, spacing: float = USUAL_SPACING, pages: int = 2048,
        shear_memory: Annotated[ShearMemory | str, word_of(*SHEAR_MEMORIES)] = ShearMemory.DIRECTION,
        pressure_normal: Annotated[PressureNormal | str, word_of(*PRESSURE_NORMALS)] = PressureNormal.GROUND,
        weighted: Flag = True, per_world: Flag = False,
        bulldozing: Annotated[Bulldozing, instance_of(Bulldozing, "Bulldozing() is usual")] | None = None,
        soil_map: Any = None, map_origin: tuple[float, float] = (0.0, 0.0), map_cell: tuple[float, float] = (1.0, 1.0),
        wheels: Sequence[SoilShape] = (), meshes: Sequence[SoilMesh] = (),
    ) -> None:  # fmt: skip
        self.model = model
        self.shapes = (*checked_shapes(shapes), *checked_shapes(wheels))
        bladed = any(isinstance(shape, SoilBlade) for shape in self.shapes)
        self.meshes = checked_meshes(meshes, bulldozing is not None, bladed)
        self.soils = soils_of(soil)
        self.spacing = _checked_spacing(spacing, self.shapes, self.meshes)
        least = pages_at_a_time(self.shapes, self.spacing) + pages_below(self.meshes, self.spacing)
        self.pages = checked_pages(pages, self.spacing, least)
        worlds, device = model.world_count, model.device
        rows = np.tile(np.array([each.values() for each in self.soils]), (worlds if per_world else 1, 1, 1))
        self.parameter = writable_from(rows, wp.float32, device)
        assert rows.shape[2] == PARAMETERS
        tables: Any = SoilTables()
        self._tables = tables
        tables.spacing = self.spacing
        tables.weighted = int(weighted)
        tables.scalar_shear = int(ShearMemory(shear_memory) is ShearMemory.SCALAR)
        tables.along_surface = int(PressureNormal(pressure_normal) is PressureNormal.SURFACE)
        tables.length, tables.rest_time = DIRECTION_LENGTH, REST_TIME
        tables.rest_speed = REST_SPEED
        tables.parameter = self.parameter
        places: Any = checked_map(soil_map, len(self.soils), worlds)
        tables.soil_map = wp.array(places, dtype=int, device=device)
        below = plane(device) if ground is None else ground
        check_ground(below)
        tables.terrain = below
        check_map(places.shape, map_origin, map_cell, tables.terrain, model)
        tables.map_origin, tables.map_cell = wp.vec2d(*map_origin), wp.vec2d(*map_cell)
        self._shapes = shape_tables(model, self.shapes)
        self._sheets = sheet_tables(model, self.meshes)
        self._carriers = carriers_of(model, self.shapes)
        self._sheet_nodes = tuple(int(body) for body in self._sheets.body.numpy())
        self.bulldozing = bulldozing
        self._flow = None if bulldozing is None else SoilFlow(bulldozing, self.shapes, self.spacing)
        self._blades = Blades(self.shapes, self.spacing, device) if bladed else None
        tables.pushed = 0.0 if bulldozing is None else bulldozing.flow
        each = (worlds, len(self.shapes) + len(self.meshes))
        self._nodes = _nodes(worlds, self.pages, each[1], self._moves_soil, device)
        self._reports = with_zeros(SoilReports(), each, device)
        self.load: wp.array = self._reports.load
        self.sinkage: wp.array = self._reports.sinkage
        self.slip_ratio: wp.array = self._reports.slip_ratio
        self.touched: wp.array = self._reports.touched
        self.force_w: wp.array = self._reports.force_w
        self.torque_w: wp.array = self._reports.torque_w
        self.recycled: wp.array = self._nodes.recycled
        self.rest_force_b = writable(each, wp.vec3, device, label="soil.rest_force_b")
        self.rest_torque_b = writable(each, wp.vec3, device, label="soil.rest_torque_b")
        self._all_worlds = wp.full(worlds, True, dtype=wp.bool, device=device)
        self._shift = wp.zeros(each, dtype=float, device=device)
        self._imprinting: tuple[WorldLaunch, ...] = ()

    def _readable_title(self) -> str:
        kinds, shapes = plural(len(self.soils), "soil"), plural(len(self.shapes) + len(self.meshes), "shape")
        return f": {kinds}, {shapes} in each of {plural(self.model.world_count, 'world')}"

    def _readable_rows(self) -> Mapping[str, Row]:
        each = PAGE_NODES * (NODE_VALUES + self._moves_soil) * 4
        rows: dict[str, Row] = {
            "nodes": f"every {self.spacing:g} m, in {self.pages} pages per world ({self.pages * each / 1e6:.2g} MB)",
        }
        if self.bulldozing is not None:
            rows["bulldozing"] = self.bulldozing.description()
        return rows

    @property
    def _moves_soil(self) -> bool:
        """Nodes may rise and be cut."""
        return self.bulldozing is not None or self._blades is not None

    @property
    def wheels(self) -> tuple[SoilWheel, ...]:
        """Those of its shapes that are wheels."""
        return tuple(shape for shape in self.shapes if isinstance(shape, SoilWheel))

    @property
    def cover(self) -> Any:
        """The struct that rays and height queries read: `Scene.cover_with`."""
        cover: Any = SoilCover()
        cover.spacing, cover.terrain, cover.nodes = self.spacing, self._tables.terrain, self._nodes
        return cover

    def height(self, points: Any) -> wp.array:
        """Heights of the deformed ground at points, launched on the soil's device.

        Between the nodes the ground is made of triangles, as cameras and lidars see it; cells without any touched node
        are undeformed. A node lies as far below as it stays pressed: what springs back under a wheel is left out.

        Args:
            points: (N, 2), (W, N, 2), or a Warp array (1 or W, N) of vec2d: x and y, world [m]. An array of another
                device is moved to the soil's.

        Returns:
            (W, N) float64, world [m]; NaN where there is no ground.

        Raises:
            ModelError: the points have another shape, or the ground is a mesh.
        """
        return self.surface(points)[0]

    def surface(self, points: Any) -> tuple[wp.array, wp.array]:
        """`height`, and (W, N) vec3 unit upward normals of the deformed ground, world axes; zeros without ground.

        Raises:
            ModelError: see `height`.
        """
        place = _checked_points(points, self.model)
        if self._tables.terrain.kind == ShapeType.MESH:
            raise ModelError("soil: height needs a plane or a height field as ground, got a mesh; make a height field")
        shape, device = (self.model.world_count, place.shape[1]), self.model.device
        height: wp.array = wp.zeros(shape, dtype=wp.float64, device=device)
        normal: wp.array = wp.zeros(shape, dtype=wp.vec3, device=device)
        inputs = [self.cover, self.model.assets, place]
        wp.launch(find_heights, dim=shape, device=device, inputs=inputs, outputs=[height, normal])
        return height, normal

    def world_problems(self) -> dict[int, str]:
        """Worlds that recycled pages since their last reset, with the remedy. Waits for the device."""
        again = self.recycled.numpy()
        return {
            int(world): f"soil: its {self.pages} pages ran out, {again[world]} were taken again and the ruts in them "
            f"are gone; Soil(pages={min(self.pages + int(again[world]), MOST_PAGES)}) keeps them"
            for world in np.nonzero(again > 0)[0]
        }  # fmt: skip

    def keep_forces(self, world_mask: Any = None) -> None:
        """Keeps the present forces on the shapes for `imprint`. Call it where everything has come to rest.

        Args:
            world_mask: (W,) bool, a Warp array, a torch tensor or anything NumPy reads; all worlds when None.

        Raises:
            ModelError: the mask is not of bool, or the soil is in no Simulation yet.
        """
        self._launch_in("keep_forces", 0, world_mask)

    def imprint(self, world_mask: Any = None) -> None:
        """Makes the soil fresh in the worlds of a mask, and presses all shapes into it where they stand. An episode
        starts as if they had come to rest there, without a fall.

        Nodes below a shape get stresses that carry `rest_force_b` and `rest_torque_b`, whatever the soil; where these
        are zero, the pressures of fresh soil at their depth. A shape above the ground leaves nothing. Poses must have
        been set before; velocities do not count.

        Args:
            world_mask: (W,) bool, a Warp array, a torch tensor or anything NumPy reads; all worlds when None.

        Raises:
            ModelError: the mask is not of bool, or the soil is in no Simulation yet.
        """
        self._launch_in("imprint", 1, world_mask)

    def resting_shifts(self, world_mask: Any = None) -> wp.array:
        """How far each shape would have to rise for fresh soil to bear the vertical part of its `rest_force_b`, as if
        it were alone. A vehicle that settled on one soil is moved by their mean before `imprint` on another.

        Args:
            world_mask: as in `imprint`; other worlds keep what they have.

        Returns:
            (W, shapes) [m], the same memory throughout; 0 for a shape without a force.

        Raises:
            ModelError: as `imprint`.
        """
        self._launch_in("resting_shifts", 2, world_mask)
        return self._shift

    def _launch_in(self, name: str, index: int, world_mask: Any) -> None:
        if self.meshes:
            raise ModelError(
                f"soil: {name} must be of a soil without meshes, got {len(self.meshes)}; let them settle instead"
            )
        if not self._imprinting:
            raise ModelError(f"soil: {name} must follow sw.Simulation(..., elements=[soil]), got none; make it first")
        mask = self._all_worlds if world_mask is None else mask_of_worlds(f"soil: {name}", world_mask, self.model)
        self._imprinting[index].use(0, mask)
        self._imprinting[index].launch()

    def record_imprint(self, simulation: StepContext, mask: wp.array) -> Sequence[WorldLaunch]:
        """The launches of `imprint` for worlds of a mask that is read when they run, for a `Simulation.program`."""
        inputs = [mask, self.rest_force_b, self.rest_torque_b, *self._placed(simulation)]
        return [simulation.shares.record(imprint_worlds, inputs=inputs, outputs=[self._nodes])]

    def _placed(self, simulation: StepContext) -> list[Any]:
        """The inputs of kernels that find where shapes stand on which soil."""
        return [self._tables, self._shapes, simulation.model.assets, simulation.state.arrays]

    def _record_imprinting(self, simulation: StepContext) -> tuple[WorldLaunch, ...]:
        """Launches of `keep_forces`, `imprint` and `resting_shifts`."""
        keep = simulation.shares.record(
            keep_forces, len(self.shapes),
            inputs=[self._all_worlds, self._shapes, simulation.state.arrays, self._reports],
            outputs=[self.rest_force_b, self.rest_torque_b],
        )  # fmt: skip
        shifts = simulation.shares.record(
            find_resting_shifts, len(self.shapes),
            inputs=[self._all_worlds, self.rest_force_b, *self._placed(simulation)], outputs=[self._shift],
        )  # fmt: skip
        return (keep, *self.record_imprint(simulation, self._all_worlds), shifts)

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that a snapshot keeps."""
        names = ["node", "place_x", "place_y", "used_at", "entry", "count", "step", "recycled", "deepest"]
        if self._moves_soil:
            names += ["raised", "highest", "pending"]
        return {name: getattr(self._nodes, name) for name in names}

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """Numbers of the soils, where they lie, the ground below, and the forces that `imprint` takes."""
        own = {"parameter": self.parameter, "soil_map": self._tables.soil_map}
        rest = {"rest_force_b": self.rest_force_b, "rest_torque_b": self.rest_torque_b}
        return own | rest | ground_rows(self._tables.terrain)

    @property
    def assigned_bodies(self) -> tuple[int, ...]:
        """Bodies whose forces and blocks it writes."""
        return (*self._carriers, *self._sheet_nodes)

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """Launches before a sub-step: pages below the shapes, then the forces on all bodies.

        Raises:
            ModelError: an element that comes later writes the forces of one of these bodies.
        """
        shared = share_bodies(self._shapes, self.model, self.shapes, _adds(self, simulation))
        self._imprinting = () if self.meshes else self._record_imprinting(simulation)
        below = [simulation.model.assets, simulation.state.arrays]
        inputs = [dt, self._tables, self._shapes, *below]
        control, record = simulation.control.arrays, simulation.shares.record
        launches = []
        if self.meshes:
            launches.append(
                record(
                    survey_sheets, len(self.meshes), inputs=[dt, self._tables, *below],
                    outputs=[self._sheets, self._nodes],
                )
            )  # fmt: skip
        launches.append(record(claim_pages, inputs=inputs, outputs=[self._nodes]))
        if self.shapes:
            out = [self._nodes, self._reports, control]
            launches.append(record(press_shapes, len(self.shapes), inputs=inputs, outputs=out))
        if self._blades is not None:
            launches.append(
                self._blades.record_forces(simulation, dt, self._placed(simulation), self._nodes, self._reports)
            )
        if self.meshes:
            launches.append(
                record(
                    press_sheets, len(self.meshes), inputs=[dt, self._tables, *below],
                    outputs=[self._sheets, self._nodes, self._reports, control],
                )
            )  # fmt: skip
        if shared:
            summed = [self._shapes, self._reports]
            launches.append(record(carry_bodies, shared, inputs=summed, outputs=[control]))
        if self._flow is not None:
            launches.append(self._flow.record(simulation, dt, self._placed(simulation), self._nodes))
        if self._blades is not None:
            launches.append(self._blades.record_cutting(simulation, dt, self._placed(simulation), self._nodes))
        return launches

    def record_after(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch after a sub-step: reports of the forces that acted in it."""
        record, state, count = simulation.shares.record, simulation.state.arrays, len(self.shapes)
        launches = []
        if self.shapes:
            launches.append(record(report_shapes, count, inputs=[dt, self._shapes, state], outputs=[self._reports]))
        if self.meshes:
            inputs = [dt, count, self._sheets, state]
            launches.append(record(report_sheets, len(self.meshes), inputs=inputs, outputs=[self._reports]))
        return launches

    def record_reset(self, simulation: StepContext, mask: wp.array) -> Sequence[Any]:
        """The launch that makes the soil fresh in worlds of a mask."""
        return [simulation.shares.record(clear_soil, inputs=[mask], outputs=[self._nodes])]


def _checked_spacing(spacing: float, shapes: Sequence[SoilShape], meshes: Sequence[SoilMesh]) -> float:
    if not shapes and not meshes:
        raise ModelError("soil: shapes must be at least one, got none; name those that sink in")
    narrowest = narrowest_width(shapes) if shapes else math.inf
    given = number(spacing)
    if not shapes:
        if not FLOAT32_LEAST <= given < math.inf:
            raise ModelError(f"soil: spacing must be positive, got {formatted(spacing)} m; 0.05 suits cars")
        return given
    if not FLOAT32_LEAST <= given <= 0.5 * narrowest:
        rule = f"positive and at most half the narrowest shape's width, {0.5 * narrowest:.4g} m"
        raise ModelError(f"soil: spacing must be {rule}, got {formatted(spacing)}; 0.05 suits cars")
    return given


def _adds(soil: Soil, simulation: StepContext) -> list[int]:
    """For each body with shapes: the soil writes its forces (0), adds to them (1), or adds to its blocks too (2)."""
    place = next(k for k, part in enumerate(simulation.elements) if part is soil)
    bodies = soil._carriers
    found = [0] * len(bodies)
    for k, part in enumerate(simulation.elements):
        held = set(soil._sheet_nodes).intersection(part.assigned_bodies)
        if held and part is not soil:
            raise ModelError(
                f"soil: node '{soil.model.body_names[min(held)]}' of a mesh must be the soil's alone, got "
                f"{type(part).__name__} on it too; push by control.body_force"
            )
        shared = [at for at, body in enumerate(bodies) if body in part.assigned_bodies]
        if k < place:
            for at in shared:
                found[at] = max(found[at], 2 if part.implicit else 1)
        elif k > place and shared and not isinstance(part, Soil):
            body = soil.model.body_names[bodies[shared[0]]]
            raise ModelError(
                f"soil: elements that act on body '{body}' must come before the soil, got {type(part).__name__} after; "
                "put the soil last"
            )
    return found


def _checked_points(points: Any, model: Model) -> wp.array:
    """(1 or W, N) vec2d on the model's device."""
    worlds = model.world_count
    rule = f"soil: points must be (N, 2), ({worlds}, N, 2), or vec2d (1 or {worlds}, N)"
    if isinstance(points, wp.array):
        if points.dtype is not wp.vec2d or points.ndim != 2 or points.shape[0] not in (1, worlds):
            raise ModelError(f"{rule}, got {formatted(points)}; make a wp.array of dtype vec2d")
        return array_on("soil: points must", points, model.device)
    values = points.detach().double() if hasattr(points, "data_ptr") else numbers(points)
    values = values[None] if values.ndim == 2 else values
    if values.ndim != 3 or values.shape[2] != 2 or values.shape[0] not in (1, worlds):
        got = tuple(values.shape) if values.ndim else formatted(points)
        raise ModelError(f"{rule}, got {got}; give x and y of each")
    if isinstance(values, np.ndarray):
        return array_from_host("soil: points must", values, model.device, wp.vec2d)
    return array_on("soil: points must", values, model.device, wp.vec2d)


def _nodes(worlds: int, pages: int, shapes: int, bulldozing: bool, device: Any) -> Any:
    nodes = with_zeros(SoilNodes(), (worlds, pages), device, "place_x", "place_y", "used_at")
    with_zeros(nodes, (worlds, pages * PAGE_NODES, NODE_VALUES), device, "node")
    with_zeros(nodes, (worlds, 1 << (2 * pages - 1).bit_length()), device, "entry")
    with_zeros(nodes, worlds, device, "count", "step", "recycled")
    with_zeros(nodes, (worlds, shapes), device, "foot", "deepest")
    with_zeros(nodes, (worlds, pages * PAGE_NODES * bulldozing), device, "raised")
    return with_zeros(nodes, (worlds, shapes * bulldozing), device, "highest", "pending")
