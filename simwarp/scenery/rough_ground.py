"""Patches of rough ground for robots on legs: height fields of a kind and a level of difficulty.

The kinds are those that legged robots are commonly trained on (Rudin et al. 2021, "Learning to Walk in Minutes Using
Massively Parallel Deep Reinforcement Learning", sec. IV; the terrains of Isaac Gym): noise, slopes, waves, steps,
stairs, stepping stones, gaps. Every patch is square, centred on the origin, level and at height 0 in its middle, where
a robot starts, and level again along its border.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Callable, Mapping
from typing import Annotated, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import Ge, Le, Lt, Meaning, Positive, Whole
from simwarp.core.types import ModelError
from simwarp.model.rules import RULES, Metres, held_fields, word_of
from simwarp.scenery.solids import between, stream, tone

Array = npt.NDArray[np.float64]
Heights = npt.NDArray[np.float32]
Nodes = npt.NDArray[np.int64]

LEVELS: Final = 10
"""Levels of difficulty, 0 to 9."""
_COLORS: Final = ("5f6fc0", "3f97b8", "5fc08a", "c8d85a", "fff07a")
"""Of the levels from the easiest to the hardest: ever brighter, so that everybody can tell them apart."""
_BOXES: Final = 60
"""Boxes and pits of `GroundKind.STEPS`; later ones lie over earlier ones."""


class GroundKind(enum.Enum):
    """Kinds of ground; up and down are seen from the middle, by who walks outwards."""

    FLAT = "flat"
    ROUGH = "rough"
    SLOPE_UP = "slope_up"
    SLOPE_DOWN = "slope_down"
    WAVES = "waves"
    STEPS = "steps"
    STAIRS_UP = "stairs_up"
    STAIRS_DOWN = "stairs_down"
    STONES = "stones"
    GAPS = "gaps"


Sizes: TypeAlias = Annotated[tuple[Metres, Metres], Meaning("two sizes [m]: those of levels 0 and 9")]
Slope: TypeAlias = Annotated[Positive, Lt(0.5 * math.pi), Meaning("radians")]
Kind: TypeAlias = Annotated[GroundKind | str, word_of(*(kind.value for kind in GroundKind))]
Level: TypeAlias = Annotated[int, Ge(0), Le(LEVELS - 1), Meaning("a level")]
Seed: TypeAlias = Annotated[Whole, Meaning("a seed")]


@dataclasses.dataclass(frozen=True)
class GroundPatch:
    """Sizes of patches. Pairs are what level 0 and level 9 have; between them it goes in equal steps.

    A height field has no vertical faces: a riser is a facet as wide as the nodes are apart. 5 cm is a little more than
    the diameter of a foot of 2 cm radius: its box meets at most 2 x 2 cells. A riser of 15 cm is a facet of 72 degrees;
    from 6 cm on it is steeper than the 45 degrees up to which a friction of 1 holds. Half the spacing would take four
    times the memory, 0.1 MB a patch, and twice the triangles below a foot.

    Attributes:
        side: length of the sides [m].
        spacing: of the nodes [m].
        platform: side of the level square in the middle, of slopes the diameter of a level disc [m].
        rim: least width of the level border [m].
        roughness: greatest height of the noise above or depth below 0 [m].
        slope: angle of the slopes [rad]; they are cones, equally steep in all directions.
        waves: greatest height and depth of the waves [m].
        wavelength: of the waves [m].
        step: greatest height of the boxes and depth of the pits [m].
        riser: height of a stair [m].
        tread: depth of a stair from edge to edge [m].
        stone: side of the stepping stones [m].
        stride: width of the gaps between them [m].
        gap: width of the gaps [m].
        land: width of the ground between gaps [m].
        depth: of what is between stones, and of gaps [m].

    Raises:
        ModelError: a size is not positive, the side is no even number of cells, or nothing is left between the platform
            and the rim.
    """

    side: Metres = 8.0
    spacing: Metres = 0.05
    platform: Metres = 2.0
    rim: Metres = 0.5
    roughness: Sizes = (0.008, 0.08)
    slope: tuple[Slope, Slope] = (math.radians(2.5), math.radians(25.0))
    waves: Sizes = (0.02, 0.2)
    wavelength: Metres = 2.0
    step: Sizes = (0.015, 0.15)
    riser: Sizes = (0.015, 0.15)
    tread: Metres = 0.3
    stone: Sizes = (0.8, 0.35)
    stride: Sizes = (0.1, 0.3)
    gap: Sizes = (0.1, 0.55)
    land: Metres = 0.7
    depth: Metres = 0.6

    def __post_init__(self) -> None:
        """Hold the sizes to their rules."""
        held_fields("GroundPatch", GroundPatch, vars(self))
        if abs(2 * self.half * self.spacing - self.side) > 1e-6 * self.side:
            raise ModelError(
                f"GroundPatch: side must be an even number of cells of {self.spacing:g} m, got {self.side:g}; "
                "change the spacing"
            )
        if self.edge - self.inner < max(2, self.nodes(self.tread)):
            raise ModelError(
                "GroundPatch: a tread must lie between platform / 2 and side / 2 - rim, got "
                f"platform={self.platform:g}, rim={self.rim:g}, side={self.side:g}; make the side longer"
            )

    @property
    def half(self) -> int:
        """Cells from the middle to the border."""
        return round(0.5 * self.side / self.spacing)

    @property
    def inner(self) -> int:
        """Cells from the middle to the edge of the platform."""
        return round(0.5 * self.platform / self.spacing)

    @property
    def edge(self) -> int:
        """Cells from the middle to the rim."""
        return self.half - round(self.rim / self.spacing)

    def nodes(self, length: float) -> int:
        """Cells along a length [m], at least one."""
        return max(1, round(length / self.spacing))

    def at(self, sizes: tuple[float, float], level: int) -> float:
        """Size [m or rad] that a level has, of the pair that levels 0 and 9 have."""
        share = level / (LEVELS - 1)
        return (1.0 - share) * sizes[0] + share * sizes[1]


@RULES.arguments("ground_patch")
def ground_patch(
    kind: Kind, level: Level = 0, seed: Seed = 0, *, patch: GroundPatch | None = None
) -> Heights:  # fmt: skip
    """A patch of rough ground for `add_shape_height_field(..., size=(side, side))`.

    The same seed gives the same pattern on every level, higher or wider; kinds with the same seed have nothing to do
    with each other. Flat ground, slopes, stairs and gaps do not depend on the seed.

    Args:
        kind: of the ground, or its name.
        level: of difficulty, 0 to 9.
        seed: of what is random.
        patch: sizes; None: `GroundPatch()`, 8 m x 8 m.

    Returns:
        (rows, columns) float32 [m], rows along y; 0 on the platform in the middle.

    Raises:
        ModelError: there is no such kind or level, or the seed is no whole number.
    """
    chosen = GroundKind(kind)
    sizes = GroundPatch() if patch is None else patch
    heights = _MAKERS[chosen](sizes, level, stream(f"ground {chosen.value}", seed))
    return np.asarray(heights, dtype=np.float32)


def level_colors() -> Array:
    """(levels, 3) linear albedos by which pictures tell levels apart, from blue over green to yellow."""
    anchors = np.array([tone(code) for code in _COLORS])
    place = np.linspace(0.0, len(anchors) - 1.0, LEVELS)
    index = np.minimum(place.astype(int), len(anchors) - 2)
    rows = [between(anchors[i], anchors[i + 1], [t - i]) for i, t in zip(index, place, strict=True)]
    return np.concatenate(rows).astype(np.float64)


def _rings(patch: GroundPatch) -> Nodes:
    """(rows, columns) number of the square ring of nodes, 0 in the middle."""
    away = np.abs(np.arange(-patch.half, patch.half + 1))
    return np.maximum(away[:, None], away[None])


def _axis(patch: GroundPatch) -> Array:
    """(columns,) coordinates of the nodes [m]."""
    return np.arange(-patch.half, patch.half + 1, dtype=np.float64) * patch.spacing


def _between(patch: GroundPatch, heights: Array, blend: float = 0.4) -> Array:
    """Heights that go over to 0 towards the platform and the rim, over `blend` [m]."""
    width = blend / patch.spacing
    ring = _rings(patch)
    return heights * np.clip((ring - patch.inner) / width, 0.0, 1.0) * np.clip((patch.edge - ring) / width, 0.0, 1.0)


def _as_high_as(heights: Array, greatest: float) -> Array:
    return np.asarray(heights * (greatest / np.abs(heights).max()))


def _flat(patch: GroundPatch, level: int, rng: np.random.Generator) -> Array:
    return np.zeros((2 * patch.half + 1,) * 2)


def _rough(patch: GroundPatch, level: int, rng: np.random.Generator) -> Array:
    """Uniform random heights, 20 cm apart, and planes between them."""
    axis = _axis(patch)
    coarse = np.linspace(axis[0], axis[-1], math.ceil(patch.side / 0.2) + 1)
    values = rng.uniform(-1.0, 1.0, (len(coarse),) * 2)
    along = np.stack([np.interp(axis, coarse, row) for row in values])
    fine = np.stack([np.interp(axis, coarse, column) for column in along.T], axis=1)
    return _as_high_as(_between(patch, fine), patch.at(patch.roughness, level))


def _slope(patch: GroundPatch, level: int, sign: float) -> Array:
    """A cone: a pyramid is flatter along its diagonals, and saw-toothed where cells are cut across them."""
    axis = _axis(patch)
    run = np.clip(np.hypot(axis[:, None], axis[None]), patch.inner * patch.spacing, patch.edge * patch.spacing)
    return np.asarray(sign * math.tan(patch.at(patch.slope, level)) * (run - patch.inner * patch.spacing))


def _waves(patch: GroundPatch, level: int, rng: np.random.Generator) -> Array:
    """A sine along x and one along y."""
    phase = rng.uniform(0.0, 2.0 * math.pi, (2, 1))
    along, across = np.sin(2.0 * math.pi / patch.wavelength * _axis(patch) + phase)
    return _as_high_as(_between(patch, across[:, None] + along[None]), patch.at(patch.waves, level))


def _steps(patch: GroundPatch, level: int, rng: np.random.Generator) -> Array:
    """Boxes and pits, 0.3 to 1.5 m long and wide, over each other."""
    heights = np.zeros((2 * patch.half + 1,) * 2)
    low, high = patch.nodes(0.3), patch.nodes(1.5)
    for _ in range(_BOXES):
        rows, columns = rng.integers(low, high + 1, 2)
        row, column = rng.integers(patch.half - patch.edge, patch.half + patch.edge, 2)
        heights[row : row + rows, column : column + columns] = rng.choice((-1.0, -0.5, 0.5, 1.0))
    ring = _rings(patch)
    heights[(ring <= patch.inner) | (ring >= patch.edge)] = 0.0
    return _as_high_as(heights, patch.at(patch.step, level))


def _stairs(patch: GroundPatch, level: int, sign: float) -> Array:
    """A stepped pyramid of whole treads; each riser is one cell wide."""
    tread = patch.nodes(patch.tread)
    count = (patch.edge - patch.inner) // tread
    step = np.clip(np.ceil((_rings(patch) - patch.inner) / tread), 0, count)
    return np.asarray(sign * patch.at(patch.riser, level) * step)


def _stones(patch: GroundPatch, level: int, rng: np.random.Generator) -> Array:
    """Rows of square stones, each row moved along by chance; their tops differ by up to a fifth of the gaps' width."""
    side, gap = patch.nodes(patch.at(patch.stone, level)), max(2, patch.nodes(patch.at(patch.stride, level)))
    count, period = 2 * patch.half + 1, side + gap
    rows = math.ceil(count / period)
    # of a gap of g cells, g - 1 nodes lie deep
    place = np.arange(count) - (count - period * rows) // 2
    number, within = place // period, place % period
    shift = rng.integers(0, 2**31, rows + 1) % period
    tops = rng.uniform(-0.1, 0.1, (rows + 1, rows + 2)) * gap * patch.spacing
    across = (place[None] + shift[number][:, None]) % period
    column = (place[None] + shift[number][:, None]) // period
    stone = (within[:, None] <= side) & (across <= side)
    heights = np.where(stone, tops[number[:, None], column], -patch.depth)
    ring = _rings(patch)
    return np.where((ring <= patch.inner) | (ring >= patch.edge), 0.0, heights)


def _gaps(patch: GroundPatch, level: int, rng: np.random.Generator) -> Array:
    """Square trenches about the platform, as wide at the top as said, with land between them."""
    width, land = max(2, patch.nodes(patch.at(patch.gap, level))), patch.nodes(patch.land)
    ring = _rings(patch)
    heights = np.zeros(ring.shape)
    first = patch.inner + patch.nodes(0.1)
    while first + width <= patch.edge:
        heights[(ring > first) & (ring < first + width)] = -patch.depth
        first += width + land
    return heights


_MAKERS: Final[Mapping[GroundKind, Callable[[GroundPatch, int, np.random.Generator], Array]]] = {
    GroundKind.FLAT: _flat,
    GroundKind.ROUGH: _rough,
    GroundKind.SLOPE_UP: lambda patch, level, _: _slope(patch, level, 1.0),
    GroundKind.SLOPE_DOWN: lambda patch, level, _: _slope(patch, level, -1.0),
    GroundKind.WAVES: _waves,
    GroundKind.STEPS: _steps,
    GroundKind.STAIRS_UP: lambda patch, level, _: _stairs(patch, level, 1.0),
    GroundKind.STAIRS_DOWN: lambda patch, level, _: _stairs(patch, level, -1.0),
    GroundKind.STONES: _stones,
    GroundKind.GAPS: _gaps,
}
