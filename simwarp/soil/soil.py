"""Deformable ground as a force element: wheels leave ruts in it, which later wheels meet."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import warp as wp

from simwarp.core.arrays import writable, writable_from
from simwarp.core.readable import Readable, Row, plural
from simwarp.core.types import ModelError, Vec3, shown
from simwarp.kernels.soil.pressing import clear_soil, press_wheels, report_wheels, take_pages
from simwarp.kernels.soil.soil_tables import NODE_VALUES, PAGE_NODES, PARAMETERS, SoilNodes, SoilReports, SoilTables
from simwarp.kernels.soil.soil_tables import SoilWheels as WheelTables
from simwarp.kernels.vehicle.tires.ground import TerrainTables
from simwarp.model.model import Model
from simwarp.simulation.protocols import StepContext
from simwarp.soil.soil_checks import MOST_PAGES, check_ground, check_map, checked_pages
from simwarp.soil.soil_parameters import SoilSpec, soil_preset
from simwarp.vehicle.tires.tires import ground as plane

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class SoilWheel:
    """A rigid wheel on soil: the y axis of its body is its axis.

    Attributes:
        body: index or name of the spindle.
        radius, width: [m].
        crown: radius of the tread across [m]; 0: it is flat.
        offset: of the wheel's centre from the body's centre of mass, body axes [m].
    """

    body: int | str
    radius: float
    width: float
    crown: float = 0.0
    offset: Vec3 = (0.0, 0.0, 0.0)


class Soil(Readable):
    """Deformable ground under wheels: pressure after Bekker, shear after Janosi, in nodes of a regular grid.

    Only nodes that wheels touched take memory, in pages of 8 x 8. When a world has used its pages up, the page that was
    touched longest ago is taken again, and its ruts are gone (`recycled` counts).

    Args:
        model: of the worlds.
        wheels: rigid wheels; nothing else sinks in.
        soil: a `SoilSpec`, the name of a preset (soft, mid, hard, clay, snow), or several of them for `soil_map`.
        ground: the undeformed ground (`simwarp.vehicle.tires.ground`); the plane z = 0 when None.
        spacing: of the nodes [m].
        pages: of each world, 8 x 8 nodes (1.3 KiB) each.
        shear_memory: what nodes remember of shear.
        weighted: nodes count by the share of their cell that lies inside a wheel's width.
        soil_map: (rows along y, columns along x) indices of soils, or (W, rows, columns); None: the first everywhere.
        map_origin, map_cell: corner of its first cell, and its cells' size [m].

    Attributes:
        parameter: (1 or W, soils, 8) of `SoilSpec.values`; write it where worlds differ (`per_world`).
        load, sinkage, slip_ratio: (W, wheels) vertical force [N], depth of the rut below the wheel's centre [m], slip.
        force_w, torque_w: (W, wheels) vec3 on the wheel, at its centre, world axes [N, N·m].
        touched: (W, wheels) nodes with pressure.
        recycled: (W,) pages that were taken again.

    Raises:
        ModelError: a value breaks its rule.
    """

    implicit = True

    def __init__(
        self, model: Model, wheels: Sequence[SoilWheel], soil: SoilSpec | str | Sequence[SoilSpec | str] = "mid", *,
        ground: TerrainTables | None = None, spacing: float = 0.05, pages: int = 2048,
        shear_memory: ShearMemory | str = ShearMemory.DIRECTION, weighted: bool = True, per_world: bool = False,
        soil_map: Any = None, map_origin: tuple[float, float] = (0.0, 0.0), map_cell: tuple[float, float] = (1.0, 1.0),
    ) -> None:  # fmt: skip
        self.model = model
        self.wheels = tuple(wheels)
        given = [soil] if isinstance(soil, SoilSpec | str) else list(soil)
        self.soils = tuple(soil_preset(each) if isinstance(each, str) else each for each in given)
        self.spacing = _checked_spacing(spacing, self.wheels)
        self.pages = checked_pages(pages, self.spacing, [(wheel.radius, wheel.width) for wheel in self.wheels])
        worlds, device = model.world_count, model.device
        rows = np.tile(np.array([each.values() for each in self.soils]), (worlds if per_world else 1, 1, 1))
        self.parameter = writable_from(rows, wp.float32, device)
        assert rows.shape[2] == PARAMETERS
        tables: Any = SoilTables()
        self._tables = tables
        tables.spacing = self.spacing
        tables.weighted = int(weighted)
        tables.scalar_shear = int(_checked_memory(shear_memory) is ShearMemory.SCALAR)
        tables.length, tables.rest_time = DIRECTION_LENGTH, REST_TIME
        tables.rest_speed = REST_SPEED
        tables.parameter = self.parameter
        places: Any = _checked_map(soil_map, len(self.soils), worlds)
        tables.soil_map = wp.array(places, dtype=int, device=device)
        tables.terrain = plane(device) if ground is None else ground
        check_ground(tables.terrain)
        check_map(places.shape, map_origin, map_cell, tables.terrain, model)
        tables.map_origin, tables.map_cell = wp.vec2d(*map_origin), wp.vec2d(*map_cell)
        self._wheels = _wheel_tables(model, self.wheels)
        self._nodes = _nodes(worlds, self.pages, device)
        self._reports = _reports((worlds, len(self.wheels)), device)

    def _printed_title(self) -> str:
        kinds = plural(len(self.soils), "soil")
        return f": {kinds}, {plural(len(self.wheels), 'wheel')} in each of {plural(self.model.world_count, 'world')}"

    def _printed_rows(self) -> Mapping[str, Row]:
        each = PAGE_NODES * NODE_VALUES * 4
        return {
            "nodes": f"every {self.spacing:g} m, in {self.pages} pages per world ({self.pages * each / 1e6:.2g} MB)",
        }

    @property
    def load(self) -> wp.array:
        """(W, wheels) vertical force on each wheel [N]."""
        return self._reports.load

    @property
    def sinkage(self) -> wp.array:
        """(W, wheels) depth of the soil below each wheel's centre [m]."""
        return self._reports.sinkage

    @property
    def slip_ratio(self) -> wp.array:
        """(W, wheels), positive when driving."""
        return self._reports.slip_ratio

    @property
    def touched(self) -> wp.array:
        """(W, wheels) nodes with pressure."""
        return self._reports.touched

    @property
    def force_w(self) -> wp.array:
        """(W, wheels) vec3 on each wheel at its centre, world axes [N]."""
        return self._reports.force_w

    @property
    def torque_w(self) -> wp.array:
        """(W, wheels) vec3 about each wheel's centre, world axes [N·m]."""
        return self._reports.torque_w

    @property
    def recycled(self) -> wp.array:
        """(W,) pages that were taken again since the last reset."""
        return self._nodes.recycled

    def world_problems(self) -> dict[int, str]:
        """Worlds that took pages again since their last reset, with the remedy. Waits for the device."""
        again = self.recycled.numpy()
        return {
            int(
                world
            ): f"soil: its {self.pages} pages ran out, {again[world]} were taken again and the ruts in them are "
            f"gone; Soil(pages={min(self.pages + int(again[world]), MOST_PAGES)}) keeps them"
            for world in np.nonzero(again > 0)[0]
        }

    # ---- ForceElement ----------------------------------------------------------------------------------------------

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that a snapshot keeps."""
        names = ("node", "place_x", "place_y", "used_at", "entry", "count", "step", "recycled")
        return {name: getattr(self._nodes, name) for name in names}

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """Launches before a sub-step: pages below the wheels, then their forces."""
        inputs = [dt, self._tables, self._wheels, simulation.model.assets, simulation.state.arrays]
        return [
            simulation.shares.record(take_pages, inputs=inputs, outputs=[self._nodes]),
            simulation.shares.record(
                press_wheels, len(self.wheels), inputs=inputs,
                outputs=[self._nodes, self._reports, simulation.control.arrays],
            ),
        ]  # fmt: skip

    def record_after(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch after a sub-step: what acted in it."""
        return [
            simulation.shares.record(
                report_wheels, len(self.wheels),
                inputs=[dt, self._wheels, simulation.control.arrays, simulation.state.arrays], outputs=[self._reports],
            )
        ]  # fmt: skip

    def record_reset(self, simulation: StepContext, mask: wp.array) -> Sequence[Any]:
        """The launch that makes the soil fresh in worlds of a mask."""
        return [simulation.shares.record(clear_soil, inputs=[mask], outputs=[self._nodes])]


def _checked_spacing(spacing: float, wheels: Sequence[SoilWheel]) -> float:
    if not wheels:
        raise ModelError("soil: wheels must be at least one, got none; name those that sink in")
    narrowest = min(wheel.width for wheel in wheels)
    if not 0.0 < spacing <= 0.5 * narrowest:
        rule = f"positive and at most half the narrowest wheel's width, {0.5 * narrowest:.4g} m"
        raise ModelError(f"soil: spacing must be {rule}, got {shown(spacing)}; 0.05 suits cars")
    return float(spacing)


def _checked_memory(memory: Any) -> ShearMemory:
    try:
        return ShearMemory(memory)
    except ValueError:
        names = " or ".join(each.value for each in ShearMemory)
        raise ModelError(f"soil: shear_memory must be {names}, got {shown(memory)}; scalar is Chrono's") from None


def _checked_map(soil_map: Any, soils: int, worlds: int) -> np.ndarray[Any, np.dtype[np.int32]]:
    if soil_map is None:
        return np.zeros((1, 0, 0), np.int32)
    values = np.asarray(soil_map)
    values = values[None] if values.ndim == 2 else values
    if values.ndim != 3 or values.shape[0] not in (1, worlds) or not values.size:
        raise ModelError(f"soil: soil_map must be (rows, columns) or ({worlds}, rows, columns), got {values.shape}")
    if values.min() < 0 or values.max() >= soils:
        raise ModelError(f"soil: soil_map must hold indices below {soils}, got {int(values.max())}; name more soils")
    return values.astype(np.int32)


def _wheel_tables(model: Model, wheels: Sequence[SoilWheel]) -> Any:
    device = model.device
    bodies = [model.body(wheel.body) if isinstance(wheel.body, str) else int(wheel.body) for wheel in wheels]
    if len(set(bodies)) < len(bodies):
        raise ModelError(f"soil: wheels must be on different bodies, got {bodies}; leave one of them out")
    table: Any = WheelTables()
    table.body = wp.array(bodies, dtype=int, device=device)
    table.offset_b = wp.array(np.array([wheel.offset for wheel in wheels]), dtype=wp.vec3, device=device)
    for name, values in (
        ("radius", [wheel.radius for wheel in wheels]),
        ("half_width", [0.5 * wheel.width for wheel in wheels]),
        ("crown", [wheel.crown for wheel in wheels]),
    ):
        setattr(table, name, wp.array(values, dtype=float, device=device))
    return table


def _nodes(worlds: int, pages: int, device: Any) -> Any:
    nodes: Any = SoilNodes()
    nodes.node = wp.zeros((worlds, pages * PAGE_NODES, NODE_VALUES), dtype=float, device=device)
    for name in ("place_x", "place_y", "used_at"):
        setattr(nodes, name, wp.zeros((worlds, pages), dtype=int, device=device))
    nodes.entry = wp.zeros((worlds, 1 << (2 * pages - 1).bit_length()), dtype=int, device=device)
    for name in ("count", "step", "recycled"):
        setattr(nodes, name, wp.zeros(worlds, dtype=int, device=device))
    return nodes


def _reports(shape: tuple[int, int], device: Any) -> Any:
    reports: Any = SoilReports()
    for name in ("load", "sinkage", "slip_ratio"):
        setattr(reports, name, writable(shape, wp.float32, device))
    reports.touched = wp.zeros(shape, dtype=int, device=device)
    for name in ("force_w", "torque_w", "before_v", "before_omega"):
        setattr(reports, name, writable(shape, wp.vec3, device))
    return reports
