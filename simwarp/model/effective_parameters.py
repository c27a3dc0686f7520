"""Effect of a parameter: kernels read an entry only where the model was built with the row that it belongs to.

What is written into entries that kernels do not read is refused. `Simulation.problems()` names it where nothing else
was changed and the write named no entry: of whole arrays, through views of torch, in kernels.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from simwarp.core.arrays import ANY, Domain
from simwarp.core.fields import Size
from simwarp.core.types import BoxKind, ContactModel, DriveMode, JointType, ModelError, ShapeType
from simwarp.model.limit_order import coordinate_titles
from simwarp.model.model import Model
from simwarp.model.parameters import PARAMETERS
from simwarp.model.topology import all_sums

Mask = npt.NDArray[np.bool_]

SEEN: Final = ("shape_x", "shape_rot", "shape_size", "shape_asset", "shape_enabled")
"""Parameters of shapes that rays of sensors read too: no contact is needed."""

WITH_OFFSET: Final = (
    JointType.ROD, JointType.REVOLUTE_SPHERICAL, JointType.REVOLUTE_TRANSLATIONAL, JointType.ELASTIC,
)  # fmt: skip


class ActiveEntries(NamedTuple):
    """Entries of a parameter that have an effect.

    Attributes:
        entries: mask of those (bodies, joints, coordinates, couplings, shapes) that act in the model.
        rule: reason why the others do not, for errors.
    """

    entries: Mask
    rule: str


def effective_entries(
    model: Model, name: str, *, contact_model: str = "rigid", also: Collection[str] = ()
) -> ActiveEntries:
    """Entries of a parameter that have an effect in a model.

    Args:
        model: that it belongs to.
        name: of one of `PARAMETERS`.
        contact_model: as in `SolverOptions`.
        also: parameters that are changed beside it: zero stiffness and damping as built may become something.
    """
    size = PARAMETERS[name].sizes[1] if len(PARAMETERS[name].sizes) > 1 else None
    if size is Size.SHAPES:
        return _of_shapes(model, name, contact_model, also)
    if name in _DOFS:
        return _DOFS[name](model, also)
    if size is Size.DOFS:
        return _passive(model)
    if size is Size.COUPLINGS:
        return _of_couplings(model, name)
    if name == "joint_offset":
        holds = np.array([kind in WITH_OFFSET for kind in model.joint_types], bool)
        return ActiveEntries(holds, "only massless links and elastic joints have a length of their own")
    if size is Size.JOINTS:  # anchors and frames
        bodies = np.array([kind is not JointType.SHAFT for kind in model.joint_types], bool)
        return ActiveEntries(bodies, "shafts have no anchors and frames")
    if size is Size.MESH_PARTS:
        return _of_parts(model, name)
    if size is Size.BODIES:
        return ActiveEntries(model.has_mass, "only bodies with mass have one, and the model has none")
    return ActiveEntries(np.ones(1, bool), "")


def _boxes(model: Model, *kinds: BoxKind) -> Mask:
    """Coordinates with rows of these kinds."""
    mask = np.zeros(model.dof_count, bool)
    mask[[dof for dof, kind in model.tables.boxes if kind in kinds]] = True
    return mask


def _friction(model: Model, also: Collection[str]) -> ActiveEntries:
    rule = "dry friction acts only on coordinates that were built with friction > 0"
    return ActiveEntries(_boxes(model, BoxKind.FRICTION), rule)


def _limit(model: Model, also: Collection[str]) -> ActiveEntries:
    return ActiveEntries(_boxes(model, BoxKind.LIMIT), "stops act only on coordinates that were built with a limit")


def _effort_limit(model: Model, also: Collection[str]) -> ActiveEntries:
    rule = "it acts only where a VelocityMotor, or a PositionDrive with a finite effort_limit, was built"
    return ActiveEntries(_boxes(model, BoxKind.MOTOR, BoxKind.DRIVE), rule)


def _effort_lower(model: Model, also: Collection[str]) -> ActiveEntries:
    own = (model.drive_effort_lower.numpy() <= 0.0).any(axis=0)
    rule = "it acts only where a drive was built with effort_limit=(lower, upper); else drive_effort_limit holds for it"
    return ActiveEntries(_boxes(model, BoxKind.MOTOR, BoxKind.DRIVE) & own, rule)


def _position_drive(model: Model, also: Collection[str]) -> ActiveEntries:
    drives = np.array([effort.mode is DriveMode.POSITION for effort in model.effort_models], bool)
    return ActiveEntries(drives, "it acts only on coordinates that were built with a PositionDrive")


def _computed(model: Model) -> Mask:
    """Coordinates whose passive effort a step computes: those of the tree, and those of loops built with one."""
    return np.array([effort.is_computed for effort in model.effort_models], bool)


def _passive(model: Model) -> ActiveEntries:
    rule = "it acts on coordinates of the tree, and of loops that were built with an effort; not where motion is given"
    return ActiveEntries(_computed(model), rule)


def _rest(model: Model, also: Collection[str]) -> ActiveEntries:
    springs = np.array([effort.stiff for effort in model.effort_models], bool)
    springs |= "joint_stiffness" in also
    return ActiveEntries(_computed(model) & springs, "it acts only on coordinates that were built with a spring")


_DOFS: Final[dict[str, Callable[[Model, Collection[str]], ActiveEntries]]] = {
    "joint_friction": _friction,
    "joint_limit_lower": _limit,
    "joint_limit_upper": _limit,
    "drive_effort_limit": _effort_limit,
    "drive_effort_lower": _effort_lower,
    "drive_stiffness": _position_drive,
    "drive_damping": _position_drive,
    "joint_rest": _rest,
}
"""Those that need more than a passive effort."""


def _of_couplings(model: Model, name: str) -> ActiveEntries:
    couplings = np.arange(model.coupling_offset.shape[1]) < model.coupling_count
    if name == "coupling_offset":
        rigid = couplings & (model.coupling_damping.numpy()[0] == 0.0)
        return ActiveEntries(rigid, "only couplings that were built without damping keep a sum of coordinates")
    if name == "coupling_damping":
        return ActiveEntries(couplings, "only couplings have it; a combination has joint_damping")
    return ActiveEntries(np.ones(len(couplings), bool), "the model has no couplings")


def _of_shapes(model: Model, name: str, contact_model: str, also: Collection[str]) -> ActiveEntries:
    every = np.ones(model.shape_count, bool)
    if not model.shape_count:
        return ActiveEntries(every, "the model has no shapes")
    if name == "shape_size":
        sized = np.array([kind is not ShapeType.PLANE for kind in model.shape_types], bool)
        return ActiveEntries(sized, "planes have no size")
    if name in SEEN:
        return ActiveEntries(every, "")
    smooth = contact_model != "rigid"
    never = np.zeros(model.shape_count, bool)
    if name in ("shape_young_modulus", "shape_poisson_ratio") and not smooth:
        return ActiveEntries(never, "it acts only with SolverOptions(contact_model='smooth' or 'smooth_hooke')")
    if name in ("shape_rolling_friction", "shape_spinning_friction"):
        if smooth:
            return ActiveEntries(never, "the smooth contact model has no rolling or spinning friction")
        if not model.has_rolling_friction:
            return ActiveEntries(
                never, "contacts roll freely: no shape was built with rolling or spinning friction > 0"
            )
    if name in ("shape_compliance", "shape_damping") and smooth:
        return ActiveEntries(never, "contacts of the smooth model take their stiffness from Young's modulus")
    if name == "shape_damping" and "shape_compliance" not in also and not _any(model.shape_compliance):
        return ActiveEntries(never, "only compliant contacts relax, and no shape was built with compliance > 0")
    return ActiveEntries(
        model.shapes_that_meet, "shapes whose groups, masks and bodies let them meet no other have no contacts"
    )


def _any(array: Any) -> bool:
    return bool((array.numpy() != 0).any())


# ---- writes that change nothing --------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True, kw_only=True)
class EffectiveWrites(Domain):
    """Allowed values of a parameter of which not all entries act: a write to some entries that differs from what was
    built in those that do nothing, and in no others, is a mistake. One that reaches all, `array[:] = value`, is none.

    Attributes:
        inner: allowed values besides.
        acts, entries: of every value of the array, or of the slice of it that the domain is for: whether its entry
            acts, and which one it is.
        built: the values that they were built with.
        axes: last axes of `built` that belong to one value.
        rule: reason why the others do not act.
        titles: what errors call the entries.
    """

    inner: Domain
    acts: Mask
    entries: npt.NDArray[np.integer[Any]]
    built: npt.NDArray[Any]
    axes: int
    rule: str
    titles: Sequence[str]

    def check(self, label: str, values: npt.NDArray[Any]) -> None:
        """Raises a ModelError for the first value outside, or where the values change nothing that acts."""
        self.inner.check(label, values)
        changed = _differs(values, self.built, self.axes)
        idle = changed & ~self.acts
        if idle.any() and not (changed & self.acts).any() and len(np.unique(self.entries)) < len(self.titles):
            place = np.unravel_index(int(np.argmax(idle)), idle.shape)
            raise ModelError(f"{label}: {idle_entry(self.titles[self.entries[place]], self.rule)}")

    def at(self, shape: tuple[int, ...], key: Any) -> Domain:
        """That of a slice of an array of the given shape."""
        return dataclasses.replace(
            self, inner=self.inner.at(shape, key), acts=self.acts[key], entries=self.entries[key], built=self.built[key]
        )


def idle_entry(title: str, rule: str) -> str:
    """What is wrong with a value that was written where it does nothing."""
    return f"a value for {title} does nothing: {rule}; build it so, or leave this entry as built"


def refuse_idle_writes(model: Model) -> None:
    """From now on a write to some entries that changes only what does nothing, with any contact model, is refused."""
    for name, built in model.as_built.items():
        effects = [_effect(model, name, kind.name.lower()) for kind in ContactModel]
        acts = np.logical_or.reduce([effect.entries for effect in effects])
        rule = max(effects, key=lambda effect: int(effect.entries.sum())).rule
        if acts.all() or not built.size:
            continue
        array = getattr(model, name)
        axes = len(getattr(array.dtype, "_shape_", ()))
        places = (1, len(acts), *(1,) * (array.ndim - 2))
        array.domain = EffectiveWrites(
            inner=array.domain or ANY, acts=np.broadcast_to(acts.reshape(places), array.shape),
            entries=np.broadcast_to(np.arange(len(acts)).reshape(places), array.shape),
            built=np.broadcast_to(built[None], (array.shape[0], *built.shape)), axes=axes, rule=rule,
            titles=entry_titles(model, name),
        )  # fmt: skip


def idle_changes(model: Model, contact_model: str) -> dict[int, str]:
    """A line by world for parameters that differ from what was built, but nowhere where they act. Waits for the device.

    Args:
        model: whose parameters are read.
        contact_model: as in `SolverOptions`.
    """
    found: dict[int, list[str]] = {}
    for name, built in model.as_built.items():
        effect = _effect(model, name, contact_model)
        if effect.entries.all() or not built.size:
            continue
        array = getattr(model, name)
        changed = _differs(array.numpy(), built[None], len(getattr(array.dtype, "_shape_", ())))
        changed = np.asarray(changed.reshape(*changed.shape[:2], -1).any(axis=2))
        idle = np.asarray(changed.any(axis=1) & ~(changed & effect.entries).any(axis=1))
        for row in np.nonzero(idle)[0].tolist():
            title = entry_titles(model, name)[int(np.argmax(changed[row]))]
            line = f"{name}: {idle_entry(title, effect.rule)}"
            for world in range(model.world_count) if len(idle) < model.world_count else [row]:
                found.setdefault(world, []).append(line)
    return {world: "; ".join(lines) for world, lines in found.items()}


def _of_parts(model: Model, name: str) -> ActiveEntries:
    """Of parts of flexible meshes: thickness and pressure are of sheets."""
    parts = [part for mesh in model.builder.flexible_meshes for part in mesh.parts]
    if name in ("flexible_thickness", "flexible_pressure"):
        sheets = np.array([part.kind == "triangles" for part in parts], bool)
        return ActiveEntries(sheets, "only sheets have thickness and pressure (add_shell)")
    return ActiveEntries(np.ones(len(parts), bool), "the model has no flexible mesh (add_solid_mesh, add_shell)")


def entry_titles(model: Model, name: str) -> tuple[str, ...]:
    """What errors call the entries of a parameter."""
    size = PARAMETERS[name].sizes[1] if len(PARAMETERS[name].sizes) > 1 else None
    if size is Size.DOFS:
        return coordinate_titles(model.joint_names, model.joint_dof_start)
    if size is Size.COUPLINGS:
        return tuple(f"coupling '{spec.name}'" for spec in all_sums(model.builder))
    if size is Size.MESH_PARTS:
        meshes = model.builder.flexible_meshes
        return tuple(f"part {index} of mesh '{mesh.name}'" for mesh in meshes for index in range(len(mesh.parts)))
    kind, names = "shape", model.shape_names
    if size in (Size.BODIES, Size.JOINTS):
        kind, names = ("body", model.body_names) if size is Size.BODIES else ("joint", model.joint_names)
    return tuple(f"{kind} '{each}'" for each in names)


def _effect(model: Model, name: str, contact_model: str) -> ActiveEntries:
    """Where a parameter can act whatever else is written."""
    return effective_entries(model, name, contact_model=contact_model, also=PARAMETERS)


def _differs(values: npt.NDArray[Any], built: npt.NDArray[Any], axes: int) -> Mask:
    """Whether values, of which the last axes belong to one, are others than those that were built."""
    other = np.asarray(values != built)
    return np.asarray(other.any(axis=tuple(range(other.ndim - axes, other.ndim))) if axes else other)
