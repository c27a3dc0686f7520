"""The subject of a page: a simulation with its scene, and callables of the loop that steps it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

from simwarp.viewer.live.controls.joint_coordinates import joint_series

if TYPE_CHECKING:
    from simwarp.model.builder import ModelBuilder
    from simwarp.sensors.scene import Scene
    from simwarp.simulation.simulation import Simulation
    from simwarp.viewer.studio import Shot

Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.floating[Any]]


@dataclasses.dataclass(frozen=True, eq=False)
class Path:
    """A line beside the bodies.

    Attributes:
        points: (W, P, 3) in every world [m].
        color: sRGB, 0 to 255.
        width: [pixels].
    """

    points: Floats
    color: tuple[int, int, int] = (30, 30, 30)
    width: float = 1.5


@dataclasses.dataclass(frozen=True, eq=False)
class Actions:
    """Actions that a person may take over.

    Attributes:
        names: of the components.
        low, high: (A,) ends of the sliders.
        values: returns (W, A), those in force.
        override: of a world and a component: the value to use from now on, None: the policy's again.
    """

    names: tuple[str, ...]
    low: Floats
    high: Floats
    values: Callable[[], Floats]
    override: Callable[[int, int, float | None], None]


@dataclasses.dataclass(eq=False)
class Subject:
    """A simulation in a page. Everything but its first six fields is optional: a panel without its field is left out.

    Attributes:
        name: shown as the title.
        simulation: whose state is seen.
        scene: of its model.
        dt: time of one `advance` [s].
        advance: goes on by that much.
        reset: begins again in the worlds of a mask (W,), in all where it is None.
        shot: where the camera begins.
        paths: returns lines of all worlds: goals, limits, routes.
        trail: returns (W, 3), where the agents are on their maps [m].
        actions: that may be taken over.
        series: named numbers of one world, for plots: name -> (world index -> number).
        returns: returns (W,), rewards summed over the running episodes.
        ended: returns (W,) bool, worlds whose episode ended since it was called last.
        elements: force elements and sensors by name, as the simulation has them.
        details: further callables of single panels, by their names.
    """

    name: str
    simulation: Simulation
    scene: Scene
    dt: float
    advance: Callable[[], None]
    reset: Callable[[Mask | None], None]
    shot: Shot | None = None
    paths: Callable[[], Sequence[Path]] | None = None
    trail: Callable[[], Floats] | None = None
    actions: Actions | None = None
    series: Mapping[str, Callable[[int], float]] = dataclasses.field(default_factory=dict)
    returns: Callable[[], Floats] | None = None
    ended: Callable[[], Mask] | None = None
    elements: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    details: dict[str, Any] = dataclasses.field(default_factory=dict)


def subject_of(simulation: Simulation, scene: Scene | None = None, *, name: str = "simulation") -> Subject:
    """A simulation alone; its shapes are painted where no scene is given.

    Raises:
        ModelError: no scene is given, and the simulation's model does not know its builder.
    """
    if scene is None:
        from simwarp.sensors.scene import Visuals
        from simwarp.viewer.default_visuals import add_bodies, paint

        visuals = Visuals(cast("ModelBuilder", simulation.model.builder))
        if not any(instance.body >= 0 for instance in visuals.instances):
            add_bodies(visuals)
        paint(visuals)
        scene = visuals.finalize(simulation.model)
    return Subject(
        name, simulation, scene, simulation.dt, simulation.step, simulation.reset, series=joint_series(simulation)
    )  # fmt: skip
