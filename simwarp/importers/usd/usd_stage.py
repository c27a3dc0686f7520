"""A USD stage: opened without leaving its folders, its units and its vertical, and what is not of UsdPhysics."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ModelError, Pose, pose as make_pose
from simwarp.core.wording import shortened
from simwarp.importers.report import ImportReport
from simwarp.importers.source_files import FileFolders, needed

Array = npt.NDArray[np.float64]

ARMATURE: Final = ("physxJoint:armature", "mjc:armature", "newton:armature")
"""Attributes of other engines that are held: inertia on a coordinate."""

ANYWHERE: Final = ("xformOp", "primvars", "userProperties", "ui", "material", "info", "inputs", "outputs")
"""Name spaces of attributes that say nothing about motion."""

OPEN_GRAVITY: Final = 1.0e6
"""Gravity beyond it means the default."""

ADDRESS: Final = re.compile(r" <0x[0-9a-f]+>")
"""Of an object in memory, in a warning of OpenUSD."""

PHYSICS: Final = ("Physics", "Physx", "Mjc", "Newton", "warp", "Tensor", "Isaac")


@dataclasses.dataclass(frozen=True)
class Units:
    """Of a stage, in SI.

    Attributes:
        length: of one unit [m].
        mass: of one unit [kg].
    """

    length: float
    mass: float

    @property
    def inertia(self) -> float:
        """kg·m² of one unit; of a torque, too, since seconds are seconds."""
        return self.mass * self.length**2


@dataclasses.dataclass(frozen=True)
class Stage:
    """An opened stage.

    Attributes:
        usd: of pxr.
        physics: module UsdPhysics.
        geometry: module UsdGeom.
        units: of lengths and masses.
        world: pose of its world in one whose vertical is z.
        objects: kind (`UsdPhysics.ObjectType` by name) -> descriptions that the parser of UsdPhysics gives.
    """

    usd: Any
    physics: Any
    geometry: Any
    units: Units
    world: Pose
    objects: dict[str, list[Any]]

    def of(self, *kinds: str) -> list[Any]:
        """Descriptions of kinds, in the order of their paths in the file."""
        order = {str(prim.GetPath()): number for number, prim in enumerate(self.prims())}
        found = [description for kind in kinds for description in self.objects.get(kind, [])]
        return sorted(found, key=lambda description: order.get(str(description.primPath), len(order)))

    def prims(self) -> Any:
        """All prims, those within instances as if each instance had its own."""
        usd = needed("pxr.Usd", "USD", "usd")
        return usd.PrimRange.Stage(self.usd, usd.TraverseInstanceProxies())

    def prim(self, path: Any) -> Any:
        """The prim at a path."""
        return self.usd.GetPrimAtPath(path)


@contextlib.contextmanager
def warnings_reported(file: Path, report: ImportReport, *, composing: bool = False) -> Iterator[None]:
    """What OpenUSD would write to the terminal goes into the report: as near while a stage is composed, since parts of
    it are missing then, and else as notes on what our own lines say.
    """
    delegate = needed("pxr.UsdUtils", f"{file.name}: reading USD", "usd").CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        for found in delegate.TakeUncoalescedDiagnostics():
            text = ADDRESS.sub("", " ".join(str(found.commentary).split()))
            if composing:
                report.approximate("composition", text, "parts of the stage are missing, as OpenUSD warns")
            else:
                report.hold("reader", "", f"OpenUSD warns: {text}")
        del delegate  # it listens as long as it lives


def open_stage(file: Path, folders: FileFolders, report: ImportReport) -> Stage:
    """Opens a stage, once all layers that it is composed of are known to lie in its folders.

    Raises:
        ModelError: it is no USD file, a layer is outside or missing, or its units are not usable.
    """
    pxr = needed("pxr", f"{file.name}: reading USD", "usd")
    usd, geometry, physics, sdf, tf = (
        needed(f"{pxr.__name__}.{name}", f"{file.name}: reading USD", "usd")
        for name in ("Usd", "UsdGeom", "UsdPhysics", "Sdf", "Tf")
    )
    try:
        with warnings_reported(file, report, composing=True):
            _check_layers(sdf, file, folders)
            stage = usd.Stage.Open(str(file))
        with warnings_reported(file, report), warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # its successor is not wrapped yet
            parsed = physics.LoadUsdPhysicsFromRange(stage, ["/"])
    except tf.ErrorException as error:
        told = " ".join(str(error).split()).rpartition(" : ")[2].strip("' ").replace(f"{file}:", "line ")
        raise ModelError(f"{file.name}: must be a USD file, got: {shortened(told)}; the file may be cut off") from None
    objects = {str(kind).rpartition(".")[2]: list(descriptions) for kind, (_, descriptions) in parsed.items()}
    length, mass = float(geometry.GetStageMetersPerUnit(stage)), float(physics.GetStageKilogramsPerUnit(stage))
    for name, value in (("metersPerUnit", length), ("kilogramsPerUnit", mass)):
        if not 0.0 < value < np.inf:
            raise ModelError(f"{file.name}: {name} must be > 0, got {value}; write 1 for SI units")
    up = str(geometry.GetStageUpAxis(stage))
    turned = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)) if up == "Y" else (0.0, 0.0, 0.0, 1.0)
    return Stage(stage, physics, geometry, Units(length, mass), make_pose(rotation=turned), objects)


def _check_layers(sdf: Any, file: Path, folders: FileFolders) -> None:
    """Every layer that is sublayered, referenced or a payload, and theirs."""
    seen: set[str] = set()
    stack = [str(file)]
    while stack:
        path = stack.pop()
        if path in seen:
            continue
        seen.add(path)
        layer = sdf.Layer.FindOrOpen(path)
        if layer is None:
            raise ModelError(f"{file.name}: must be a USD file, got one that cannot be opened; export it again")
        for asset in layer.GetCompositionAssetDependencies():
            if not asset:
                continue
            beside = os.path.join(os.path.relpath(os.path.dirname(path) or ".", file.parent), asset)
            try:
                stack.append(str(folders.resolve(asset if "://" in asset else os.path.normpath(beside))))
            except ModelError as error:
                raise ModelError(f"{file.name}: layer {error}") from None


def report_foreign(stage: Stage, report: ImportReport, held: Sequence[str]) -> None:
    """Names every attribute of physical prims that UsdPhysics does not define, but those that are held."""
    for prim in stage.prims():
        schemas = [str(name) for name in prim.GetAppliedSchemas()] + [
            str(name) for name in prim.GetPrimTypeInfo().GetAppliedAPISchemas()
        ]
        if not str(prim.GetTypeName()).startswith("Physics") and not any(name.startswith(PHYSICS) for name in schemas):
            continue
        defined = {str(name) for name in prim.GetPrimDefinition().GetPropertyNames()}
        for attribute in prim.GetAuthoredAttributes():
            name = str(attribute.GetName())
            named = name.startswith("mjcf:") and name.endswith(":name")  # of the axes of a D6 joint
            if name not in defined and name not in held and not named and name.partition(":")[0] not in ANYWHERE:
                report.approximate("attribute", name, "not of UsdPhysics; left out")


def foreign_value(prim: Any, names: Sequence[str]) -> float:
    """The first of some attributes of other engines that is there; 0 where none is."""
    for name in names:
        attribute = prim.GetAttribute(name)
        value = attribute.Get() if attribute else None
        if isinstance(value, (int, float)):
            return float(value)
    return 0.0


def vector(value: Any) -> Array:
    """A Gf vector as an array."""
    return np.array([float(value[0]), float(value[1]), float(value[2])])


def quaternion(value: Any) -> Array:
    """A Gf quaternion as xyzw of length 1."""
    x, y, z = value.GetImaginary()
    xyzw = np.array([float(x), float(y), float(z), float(value.GetReal())])
    length = float(np.linalg.norm(xyzw))
    return xyzw / length if length > 0.0 else np.array([0.0, 0.0, 0.0, 1.0])
