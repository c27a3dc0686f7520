"""What a file only shows: parts on links, put into `Visuals` when somebody asks for them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from simwarp.core.types import Pose, ShapeType, pose as make_pose
from simwarp.geometry.visual_mesh import VisualMesh
from simwarp.importers.imported import NamedFrame
from simwarp.importers.links.link_tree import frame_on

if TYPE_CHECKING:
    from simwarp.sensors.scene import Visuals


@dataclasses.dataclass(frozen=True, kw_only=True)
class LinkVisual:
    """One visible part.

    Attributes:
        name: without the prefix.
        link: that carries it, without the prefix.
        kind: a primitive, or MESH.
        size: as `ShapeType` tells [m]; of a mesh unused.
        pose: of its frame in the link's.
        mesh: reads the mesh, of a MESH; it runs when the part is shown, and gives None where that is dropped.
        color: linear albedo; that of the mesh, or grey, when None.
    """

    name: str
    link: str
    kind: ShapeType
    size: tuple[float, float, float] = (1.0, 1.0, 1.0)
    pose: Pose = dataclasses.field(default_factory=make_pose)
    mesh: Callable[[], VisualMesh | None] | None = None
    color: tuple[float, float, float] | None = None


def visuals_of_links(
    parts: Sequence[LinkVisual], frames: Mapping[str, NamedFrame], shapes_of: Mapping[str, tuple[int, ...]], prefix: str
) -> Callable[[Visuals], None]:
    """What `Imported.add_visuals` calls: collision shapes of links that have visible parts are hidden behind these."""

    def show(visuals: Visuals) -> None:
        for link in dict.fromkeys(part.link for part in parts):
            visuals.hide(*shapes_of.get(prefix + link, ()))
        for part in parts:
            _add(visuals, part, frames, prefix)

    return show


def _add(visuals: Visuals, part: LinkVisual, frames: Mapping[str, NamedFrame], prefix: str) -> None:
    frame = frame_on(frames, prefix + part.link, part.pose)
    mesh = part.mesh() if part.mesh is not None else None
    if mesh is None and part.kind is ShapeType.MESH:
        return
    add_part(visuals, f"{prefix}{part.name}", frame, part.kind, part.size, mesh, part.color)


def add_part(
    visuals: Visuals, name: str, frame: NamedFrame, kind: ShapeType, size: tuple[float, float, float],
    mesh: VisualMesh | None = None, color: tuple[float, float, float] | None = None,
) -> None:  # fmt: skip
    """Adds one visible part in a frame: a primitive of a `size` as `ShapeType` tells [m], or a mesh."""
    options: dict[str, Any] = {"name": name, "pose": frame.pose}
    if color is not None:
        options["color"] = color
    if mesh is not None:
        visuals.add_mesh(frame.body, mesh, **options)
    else:
        visuals.add_primitive(frame.body, kind, size, **options)
