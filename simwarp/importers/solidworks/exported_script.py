"""The script of the exporter as data: a short list of statements and calls is understood, nothing is run."""

from __future__ import annotations

import ast
import dataclasses
import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of, quat_from_matrix
from simwarp.core.types import FLOAT32_MAX, ModelError, Pose, formatted, pose as make_pose
from simwarp.core.wording import nearest
from simwarp.importers.links.link_frames import scalar_first
from simwarp.importers.report import ImportReport

Array = npt.NDArray[np.float64]

OLD: Final = "ChVectorD"
"""The vector of releases before 9, in which the axis of a mate is x."""

CLASSES: Final = (
    "ChBodyAuxRef", "ChMarker", "ChCollisionModel",
    "ChVisualShapeModelFile", "ChModelFileShape", "ChObjShapeFile", "ChObjFileShape", "ChAssetLevel",
    "ChContactMaterialNSC", "ChMaterialSurfaceNSC", "ChContactMaterialSMC", "ChMaterialSurfaceSMC",
    "ChCollisionShapeBox", "ChCollisionShapeSphere", "ChCollisionShapeCylinder", "ChCollisionShapeConvexHull",
    "ChCollisionShapeTriangleMesh", "ChTriangleMeshConnected",
)  # fmt: skip
"""Objects that the reader knows besides links, which it looks at by name."""

GETTERS: Final = ("GetCollisionModel", "GetFrame", "GetAssets")
"""Calls that hand out a part of an object."""


@dataclasses.dataclass
class Call:
    """A call of a method of an object, with its values."""

    method: str
    values: list[Any]
    line: int


@dataclasses.dataclass(eq=False)
class Record:
    """An object of the script: the class, what it was made of, and what was done to it.

    Attributes:
        kind: class, without the module.
        values: arguments of its construction.
        line: of the script.
        calls: in order; those of its parts under "GetCollisionModel.AddBox" and so on.
        items: what was pushed into it, of a list.
    """

    kind: str
    values: list[Any]
    line: int
    calls: list[Call] = dataclasses.field(default_factory=list)
    items: list[Any] = dataclasses.field(default_factory=list)

    def last(self, *methods: str) -> Call | None:
        """The last call of any of the methods."""
        return next((call for call in reversed(self.calls) if call.method in methods), None)


@dataclasses.dataclass
class Matrix:
    """A 3x3 matrix whose entries are set one by one."""

    entries: Array

    @property
    def rotation(self) -> Array:
        """As a quaternion xyzw."""
        return quat_from_matrix(self.entries)


@dataclasses.dataclass
class Script:
    """What was read: the objects in `exported_items`, and whether the dialect is the old one."""

    items: list[Record]
    is_old: bool


class _Unknown(Exception):
    """Something that is not on the list; its text says what."""


class ScriptReader:
    """Reads the statements of a script, one after the other.

    Args:
        source: the file, for errors.
        report: where statements that are not understood are refused.
    """

    def __init__(self, source: str, report: ImportReport) -> None:
        self.source = source
        self.names: dict[str, Any] = {}
        self.module = ""
        self._report = report

    def read(self, text: str) -> Script:
        """The objects of a script.

        Raises:
            ModelError: it is no Python, or exports nothing.
        """
        try:
            tree = ast.parse(text)
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            told = getattr(error, "msg", None) or type(error).__name__
            line = getattr(error, "lineno", None) or 0
            raise ModelError(
                f"{self.source}: line {line}: must be Python, got: {told}; the file may be cut off"
            ) from None
        for statement in tree.body:
            try:
                self._statement(statement)
            except _Unknown as unknown:
                self._report.refuse("statement", f"line {statement.lineno}", f"{unknown}: not written by the exporter")
            except RecursionError:
                raise ModelError(
                    f"{self.source}: line {statement.lineno}: must be a plain value, got one too deep"
                ) from None
        items = self.names.get("exported_items")
        if not isinstance(items, list) or not all(isinstance(item, Record) for item in items):
            raise ModelError(f"{self.source}: must fill the list exported_items; export it with Chrono::SolidWorks")
        return Script(items, OLD in text)

    # ---- statements -------------------------------------------------------------------------------------------------

    def _statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Import(names=names) if all(name.name in ("pychrono", "builtins") for name in names):
                for name in names:
                    if name.name == "pychrono":
                        self.module = name.asname or name.name
            case ast.If(test=ast.Call(func=ast.Name(id="hasattr"))):
                return  # a folder that a caller may have set
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                self.names[name] = self._value(value)
            case ast.Assign(targets=[ast.Subscript(value=ast.Name(id=name), slice=index)], value=value):
                self._set_entry(name, self._value(index), self._value(value))
            case ast.Expr(value=ast.Constant()):
                return
            case ast.Expr(value=ast.Call() as call):
                self._value(call)
            case _:
                raise _Unknown(f"a statement '{formatted(ast.unparse(node).splitlines()[0])[1:-1]}'")

    def _set_entry(self, name: str, index: Any, value: Any) -> None:
        matrix = self.names.get(name)
        if not isinstance(matrix, Matrix) or index not in [(i, j) for i in range(3) for j in range(3)]:
            raise _Unknown(f"an entry {formatted(index)} of '{name}'")
        matrix.entries[index] = _number(value)

    # ---- values -----------------------------------------------------------------------------------------------------

    def _value(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=value) if isinstance(value, (str, int, float, bool)):
                return value
            case ast.Name(id=name):
                if name not in self.names:
                    raise _Unknown(f"the name '{name}', which has no value{nearest(name, self.names)}")
                return self.names[name]
            case ast.List(elts=[]):
                return []
            case ast.Tuple(elts=parts):
                return tuple(self._value(part) for part in parts)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -_number(self._value(operand))
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                return _joined(self._value(left), self._value(right))
            case ast.Attribute(value=ast.Name(id=module), attr="QUNIT") if module == self.module:
                return make_pose().rotation
            case ast.Attribute(value=ast.Name(id=module), attr="VNULL") if module == self.module:
                return np.zeros(3)
            case ast.Call(func=ast.Attribute(value=ast.Name(id=module), attr=kind)) if module == self.module:
                return self._made(kind, self._arguments(node), node.lineno)
            case ast.Call(
                func=ast.Attribute(value=ast.Attribute(attr="ChTriangleMeshConnected"), attr="CreateFromWavefrontFile")
            ):
                mesh = Record("ChTriangleMeshConnected", [], node.lineno)
                mesh.calls.append(Call("LoadWavefrontMesh", self._arguments(node)[:1], node.lineno))
                return mesh
            case ast.Call(func=ast.Attribute(value=owner, attr=method)):
                return self._called(self._value(owner), method, self._arguments(node), node.lineno)
            case _:
                raise _Unknown(f"a value '{formatted(ast.unparse(node))[1:-1]}'")

    def _arguments(self, call: ast.Call) -> list[Any]:
        if call.keywords:
            raise _Unknown("named arguments")
        return [self._value(argument) for argument in call.args]

    def _made(self, kind: str, values: list[Any], line: int) -> Any:
        """A value or an object of a class of the module."""
        if kind in VALUES:
            return VALUES[kind](values)
        if kind.startswith(("vector_ChVector", "ChLink")) or kind in CLASSES:
            return Record(kind, values, line)
        raise _Unknown(f"the class {kind}{nearest(kind, (*CLASSES, *VALUES))}")

    def _called(self, owner: Any, method: str, values: list[Any], line: int) -> Any:
        if isinstance(owner, list) and method == "append" and len(values) == 1:
            owner.append(values[0])
            return None
        if not isinstance(owner, (Record, _Part)):
            raise _Unknown(f"a call of {method}")
        if isinstance(owner, Record) and method in GETTERS:
            return _Part(owner, method)
        record, name = (owner.record, f"{owner.part}.{method}") if isinstance(owner, _Part) else (owner, method)
        if name in ("push_back", "GetAssets.push_back") and len(values) == 1:
            record.items.append(values[0])
        else:
            record.calls.append(Call(name, values, line))
        return None


@dataclasses.dataclass
class _Part:
    """What a getter hands out."""

    record: Record
    part: str


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise _Unknown(f"{formatted(value)} in place of a number")
    if not math.isfinite(value) or abs(value) > FLOAT32_MAX:
        raise _Unknown(f"the number {formatted(value)}")
    return float(value)


def _joined(left: Any, right: Any) -> Any:
    if isinstance(left, str) and isinstance(right, str):
        return left + right
    raise _Unknown(f"a sum of {formatted(left)} and {formatted(right)}")


def _vector(values: list[Any]) -> Array:
    if not values:
        return np.zeros(3)
    if len(values) != 3:
        raise _Unknown(f"a vector of {len(values)} numbers")
    return np.array([_number(value) for value in values])


def _quaternion(values: list[Any]) -> Array:
    if not values:
        return make_pose().rotation
    if len(values) != 4:
        raise _Unknown(f"a quaternion of {len(values)} numbers")
    xyzw = scalar_first(_number(value) for value in values)
    length = float(np.linalg.norm(xyzw))
    if not 0.99 < length < 1.01:
        raise _Unknown(f"a quaternion of length {length:.3g}")
    return xyzw / length


def _frame(values: list[Any]) -> Pose:
    if not values:
        return make_pose()
    position = values[0]
    turn = values[1] if len(values) > 1 else make_pose().rotation
    rotation = turn.rotation if isinstance(turn, Matrix) else turn
    if not isinstance(position, np.ndarray) or not isinstance(rotation, np.ndarray) or len(values) > 2:
        raise _Unknown("a frame of other values than a vector and a rotation")
    return make_pose(position, rotation)


def _matrix(values: list[Any]) -> Matrix:
    if values and isinstance(values[0], np.ndarray) and values[0].shape == (4,):
        return Matrix(matrix_of(values[0]))
    return Matrix(np.eye(3))


VALUES: Final[dict[str, Callable[[list[Any]], Any]]] = {
    "ChVectorD": _vector, "ChVector3d": _vector, "ChQuaternionD": _quaternion, "ChQuaterniond": _quaternion,
    "ChFrameD": _frame, "ChFramed": _frame, "ChCoordsysD": _frame, "ChCoordsysd": _frame, "ChMatrix33D": _matrix,
    "ChMatrix33d": _matrix, "ChColor": _vector,
}  # fmt: skip
