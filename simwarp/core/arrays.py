"""Arrays that a user writes with `array[:, 0] = value`: Warp arrays with item assignment, which check what they get."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar, Final, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.array_devices import refuse_in_capture
from simwarp.core.types import FLOAT32_LEAST, FLOAT32_MAX, ModelError, formatted, numbers
from simwarp.core.wording import suggestion

CONVERSIONS = {
    np.float32: "float", np.float64: "double", np.int32: "int", np.int64: "long", np.uint8: "byte", np.bool_: "bool",
}  # fmt: skip
"""The tensor method that makes each NumPy type."""


Bound: TypeAlias = "float | npt.NDArray[Any]"


@dataclasses.dataclass(frozen=True)
class Domain:
    """Allowed values of an array: finite, and within bounds. Bounds of matrices are those of the diagonal.

    Attributes:
        least, most: smallest and largest one; or arrays of them that broadcast to the array's shape.
        remedy: advice for values out of bounds.
        value_axes: last axes of arrays of bounds that belong to one value: two of matrices.
    """

    least: Bound = -FLOAT32_MAX
    most: Bound = FLOAT32_MAX
    remedy: str = "replace or leave out such values"
    value_axes: int = 0

    def check(self, label: str, values: npt.NDArray[Any]) -> None:
        """Raises a ModelError for the first value outside."""
        within = (values >= self.least) & (values <= self.most)
        if values.shape[-2:] == (3, 3):
            within |= ~np.eye(3, dtype=bool)
        good = within & (np.abs(values) <= FLOAT32_MAX)  # neither is true of NaN
        if not good.all():
            values, good = np.broadcast_arrays(values, good)
            worst = values[~good].reshape(-1)[0].item()
            raise ModelError(f"{label}: values must be {self._rule()}, got {worst!r}; {self.remedy}")

    def at(self, shape: tuple[int, ...], key: Any) -> Domain:
        """That of a slice of an array of the given shape."""
        if not isinstance(self.least, np.ndarray) and not isinstance(self.most, np.ndarray):
            return self
        shape = (*shape, *(1,) * self.value_axes)
        least, most = np.broadcast_to(self.least, shape)[key], np.broadcast_to(self.most, shape)[key]
        return dataclasses.replace(self, least=least, most=most)

    def _rule(self) -> str:
        least, most = float(np.min(self.least, initial=0.0)), float(np.max(self.most, initial=-1.0))
        if most < FLOAT32_MAX:
            return f"in {least:g}..{most:g}"
        if not isinstance(self.least, np.ndarray) and self.least >= 0.0:
            return "finite and > 0 in float32" if self.least > 0.0 else "finite and >= 0"
        return "finite"


ANY: Final = Domain()
POSITIVE: Final = Domain(least=FLOAT32_LEAST)
NOT_NEGATIVE: Final = Domain(least=0.0)


class WritableArray(wp.array):
    """A Warp array whose slices can be assigned: a scalar fills, an array, tensor or sequence is copied in.

    It is the same memory and is passed to kernels, `wp.to_torch` and `wp.copy` like any Warp array. Values broadcast as
    in NumPy and are converted to the dtype of the array; vectors are a last axis of their own in values, not in keys.
    Only integers and slices are keys: for masks, index a torch view of the same memory (`interop.to_torch`).

    Values that come from the host or lie in its memory are checked where the array has a domain, those on a GPU are
    not: it would have to wait for them.

    Attributes:
        label: the array's name in errors.
        domain: allowed values; None: anything.
        hint: advice for values of another shape.
    """

    label: str = "array"
    domain: Domain | None = None
    hint: str = ""

    def __getitem__(self, key: Any) -> Any:
        view: Any = super().__getitem__(key)
        if type(view) is not wp.array:
            return view
        domain = None if self.domain is None else self.domain.at(self.shape, key)
        return _named(view, self.label, domain, self.hint)

    def __setitem__(self, key: Any, value: Any) -> None:
        slices = self._slices(key)
        if self.size == 0:
            return
        view: Any = self[slices]
        if isinstance(value, (int, float)):
            data = self._converted(value)
            self._check(data, view)
            wp.array.fill_(view, data.item())
            return
        if isinstance(value, wp.array):
            source: Any = value
            if source.shape != view.shape or source.dtype != view.dtype:
                given = f"a Warp array of {source.shape} {source.dtype.__name__}"
                raise self._unfit(view, given, "shapes and dtypes must agree")
            if view.domain is not None and source.device.is_cpu:
                self._check(source.numpy(), view)
        elif hasattr(value, "data_ptr"):
            data = self._broadcast_tensor(value, view)
            if view.domain is not None and data.device.type == "cpu":
                self._check(data.numpy(), view)
            source = wp.from_torch(data, dtype=self.dtype)
        else:
            data = self._broadcast(self._converted(value), view)
            self._check(data, view)
            source = wp.array(data, dtype=self.dtype, device="cpu", copy=False)
        self._copy_in(view, source)

    def assign(self, src: Any) -> None:
        """Copies values in, one for each: nothing broadcasts."""
        if isinstance(src, wp.array):
            if src.dtype != self.dtype or src.size != self.size:
                raise self._unfit(
                    self, f"a Warp array of {src.shape} {src.dtype.__name__}", "assign needs one for each"
                )
            if self.domain is not None and on_host(src):
                self._check(src.numpy().reshape(self._value_shape(self)), self)
            self._copy_in(self, src)
            return
        values = src if hasattr(src, "data_ptr") else self._converted(src)
        shape = self._value_shape(self)
        if int(np.prod(values.shape)) != int(np.prod(shape)):
            raise self._unfit(self, f"values of shape {tuple(values.shape)}", "assign needs one for each")
        self[...] = values.reshape(shape)

    def fill_(self, value: Any) -> None:
        """Sets every element to the same value."""
        if self.domain is not None:
            self._check(self._converted(value), self)
        super().fill_(value)

    def zero_(self) -> None:
        """Sets every element to zero."""
        if self.domain is not None:
            self._check(np.zeros(getattr(self.dtype, "_shape_", ())), self)
        super().zero_()

    def _copy_in(self, view: wp.array, source: wp.array) -> None:
        """Copies values in, also from another device; but a graph would copy later from where they no longer are."""
        if source.device != self.device:
            refuse_in_capture(f"{self.label}: values must", self.device, f"some on {source.device}")
        wp.copy(view, source)

    def _slices(self, key: Any) -> tuple[int | slice, ...]:
        """`key` as what Warp indexes with; a key of integers alone keeps its last axis, of length 1."""
        parts = list(key) if isinstance(key, tuple) else [key]
        if len(parts) == 1 and parts[0] is Ellipsis:
            parts = [slice(None)]
        for axis, part in enumerate(parts):
            if axis >= self.ndim or not isinstance(part, (int, np.integer, slice)) or isinstance(part, bool):
                raise IndexError(
                    f"{self.label} of shape {self.shape} takes up to {self.ndim} integers or slices, got "
                    f"{formatted(key)}; for masks and lists index simwarp.core.interop.to_torch(array)"
                )
            if not isinstance(part, slice):
                if not -self.shape[axis] <= part < self.shape[axis]:
                    hint = f"; {self.hint}" if self.hint and axis == 0 else ""
                    raise IndexError(
                        f"{self.label} of shape {self.shape}: index {part} is outside axis {axis} of length "
                        f"{self.shape[axis]}{hint}"
                    )
                parts[axis] = int(part) % self.shape[axis]
        if len(parts) == self.ndim and not any(isinstance(part, slice) for part in parts):
            parts[-1] = slice(parts[-1], parts[-1] + 1)
        return tuple(parts)

    def _scalar(self) -> Any:
        """NumPy type of one component: float32 mostly, float64 for positions of record and anchors."""
        return wp.dtype_to_numpy(getattr(self.dtype, "_wp_scalar_type_", self.dtype))

    def _value_shape(self, view: wp.array) -> tuple[int, ...]:
        return (*view.shape, *getattr(self.dtype, "_shape_", ()))

    def _check(self, values: npt.NDArray[Any], view: Any) -> None:
        """Raises where values do not belong to the domain of the place that gets them."""
        if view.domain is not None:
            view.domain.check(self.label, values)

    def _unfit(self, view: Any, given: str, rule: str) -> ModelError:
        """The error about values that the array cannot take."""
        place = f"{view.shape} {view.dtype.__name__}"
        return ModelError(f"{self.label}: cannot assign {given} to {place}; {self.hint or rule}")

    def _converted(self, value: Any) -> npt.NDArray[Any]:
        """Host values as NumPy's of the array's type: what it cannot hold is an error."""
        wanted = np.dtype(self._scalar())
        try:
            given = np.asarray(value)
        except (TypeError, ValueError, ArithmeticError, RuntimeError, RecursionError):
            given = np.asarray(None)
        if given.dtype == wanted:
            return given
        if given.dtype.kind == "O":
            given = numbers(value)
            if not np.isfinite(given).all():
                raise ModelError(f"{self.label}: values must be numbers, got {formatted(value)}; pass an array")
        if given.dtype.kind not in "iufb":
            raise ModelError(f"{self.label}: values must be numbers, got {formatted(value)}; pass an array")
        with np.errstate(over="ignore", invalid="ignore"):
            data = given.astype(wanted)
            same = np.isfinite(data) | ~np.isfinite(given) if wanted.kind == "f" else data.astype(given.dtype) == given
        if wanted.kind != "b" and not bool(np.all(same)):
            raise ModelError(
                f"{self.label}: values must be numbers of {wanted.name}, got {formatted(value)}; convert them"
            )
        return data

    def _broadcast(self, data: npt.NDArray[Any], view: wp.array) -> npt.NDArray[Any]:
        """Host values in the shape that `view` wants, contiguous."""
        try:
            return np.ascontiguousarray(np.broadcast_to(data, self._value_shape(view)))
        except ValueError:
            raise self._unfit(view, f"values of shape {data.shape}", "shapes must agree as in NumPy") from None

    def _broadcast_tensor(self, tensor: Any, view: wp.array) -> Any:
        """A contiguous tensor of the shape and type that `view` wants; no torch import needed for its methods."""
        try:
            # methods of the tensor's own: this file does without torch
            values = getattr(tensor.detach(), CONVERSIONS[self._scalar()])()
            return values.expand(self._value_shape(view)).contiguous()
        except RuntimeError:
            given = f"a tensor of shape {tuple(tensor.shape)}"
            raise self._unfit(view, given, "shapes must agree as in NumPy") from None


class FixedAttributes:
    """Base class with attributes that kernels refer to: they cannot be assigned, only Python would see the new one."""

    FIXED: ClassVar[tuple[str, ...]] = ()
    """The attributes that cannot be assigned; where it is empty all of them, and none can be added."""

    _fixed = False

    def _fix(self) -> None:
        """From now on attributes can be read and their arrays written to, but not assigned."""
        object.__setattr__(self, "_fixed", True)

    def __setattr__(self, name: str, value: Any) -> None:
        if not self._fixed or (self.FIXED and name not in self.FIXED):
            object.__setattr__(self, name, value)
            return
        thing = f"{type(self).__name__}.{name}"
        present = getattr(self, name, None)
        if isinstance(present, wp.array):
            how = f".{name}[...] = values" if isinstance(present, WritableArray) else f".{name}.assign(values)"
            raise ModelError(f"{thing}: cannot be replaced, kernels read the array that it is; write {how}")
        known = present is not None or name in dir(self)
        if known:
            raise ModelError(f"{thing}: cannot be replaced, it is fixed when the {type(self).__name__} is made")
        hint = suggestion(
            name, (each for each in vars(self) if not each.startswith("_")), "keep what is yours elsewhere"
        )
        raise ModelError(f"{thing}: there is no such attribute; {hint}")


def writable(
    shape: int | tuple[int, ...], dtype: Any, device: Any, *, label: str = "array", domain: Domain | None = None,
    hint: str = "",
) -> WritableArray:  # fmt: skip
    """Zeros of the given shape that support item assignment."""
    return _named(wp.zeros(shape, dtype=dtype, device=device), label, domain, hint)


def writable_from(
    data: Any, dtype: Any, device: Any, *, label: str = "array", domain: Domain | None = None, hint: str = ""
) -> WritableArray:
    """An array with the given contents that supports item assignment."""
    return _named(wp.array(data, dtype=dtype, device=device), label, domain, hint)


def with_zeros(instance: Any, shape: int | tuple[int, ...], device: Any, *names: str) -> Any:
    """The instance of a Warp struct, whose array members of these names (all when there are none) get zeros."""
    members = instance._cls.vars
    for name in names or members:
        setattr(instance, name, writable(shape, members[name].type.dtype, device))
    return instance


def on_host(array: Any) -> bool:
    """True if an array's values can be read without waiting for a device."""
    return bool(array.device.is_cpu)


def _named(array: Any, label: str, domain: Domain | None, hint: str) -> WritableArray:
    array.__class__ = WritableArray
    array.label, array.domain, array.hint = label, domain, hint
    return array


def reinterpret_int32(array: wp.array, world_count: int) -> wp.array:
    """The array's memory as (W, n) int32.

    Raises:
        ModelError: its rows are not those of worlds, or hold no whole words.
    """
    size = array.size * wp.types.type_size_in_bytes(array.dtype)
    if array.shape[0] != world_count or not array.is_contiguous or size % (4 * world_count):
        raise ModelError(
            f"force element: memory must be contiguous with leading dimension {world_count} and whole words, "
            f"got {array.dtype.__name__}{tuple(array.shape)}"
        )
    return wp.array(
        ptr=array.ptr, dtype=wp.int32, shape=(world_count, size // (4 * world_count)), device=array.device, copy=False
    )
