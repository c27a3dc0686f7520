"""Recorded launches and device memory of tasks that are written as kernels."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, ClassVar, Protocol, TypeVar

import torch
import warp as wp

from simwarp.core.interop import TensorLaunch, array_over, from_torch
from simwarp.simulation.world_launches import WorldLaunch

StructT = TypeVar("StructT")


class Batch(Protocol):
    """Worlds that are stepped together."""

    @property
    def num_worlds(self) -> int:
        """Their number W."""
        ...

    @property
    def device(self) -> torch.device:
        """Of their memory."""
        ...


def launch_over(batch: Batch, kernel: wp.Kernel, *arguments: Any) -> TensorLaunch:
    """Record the launch of a kernel with one thread for each world.

    Args:
        batch: the worlds.
        kernel: to launch.
        arguments: of the kernel; tensors may stand for arrays.
    """
    return TensorLaunch(kernel, batch.num_worlds, arguments, batch.device)


def share_over(
    simulation: Any, kernel: wp.Kernel, *arguments: Any, threads_per_world: int | None = None
) -> WorldLaunch:  # fmt: skip
    """Record the launch of a kernel over all worlds, which threads share.

    Args:
        simulation: of the worlds.
        kernel: its first parameter is a ``WorldRange``.
        arguments: of the kernel after that; tensors may stand for arrays.
        threads_per_world: second axis of the launch; None: it has but one.
    """
    kinds: list[Any] = [each.type for each in kernel.adj.args[1:]]
    inputs = [
        array_over(value, kind.dtype) if isinstance(value, torch.Tensor) else value
        for kind, value in zip(kinds, arguments, strict=True)
    ]
    launch: WorldLaunch = simulation.shares.record(kernel, threads_per_world, inputs=inputs)
    return launch


def zeros_of(struct: type[StructT], batch: Batch, **widths: int) -> StructT:
    """Return a Warp struct whose arrays are zeros with a row for each world.

    Args:
        struct: the class; it has nothing but arrays of one or two dimensions.
        batch: the worlds.
        widths: lengths of the second dimension.
    """
    made = struct()
    members: dict[str, Any] = struct.vars  # type: ignore[attr-defined]
    for name, member in members.items():
        shape = (batch.num_worlds, widths[name]) if name in widths else (batch.num_worlds,)
        setattr(made, name, wp.zeros(shape, dtype=member.type.dtype, device=str(batch.device)))
    return made


def filled(struct: type[StructT], **values: Any) -> StructT:
    """Return a Warp struct with these numbers, arrays and tensors; what is not given is 0 or of no length."""
    made = struct()
    fill(made, **values)
    return made


def fill(struct: Any, **values: Any) -> None:
    """Write numbers, arrays and tensors into a Warp struct; launches recorded before keep what they have."""
    for name, value in values.items():
        setattr(struct, name, from_torch(value) if isinstance(value, torch.Tensor) else value)


class ComputedRows:
    """A kernel whose last argument is rows (W, N), such as observations, and these rows.

    Args:
        batch: the worlds.
        kernel: with a thread for each world.
        arguments: of the kernel but the last one; tensors may stand for arrays.
        width: N. None: the rows are (W,).
        dtype: of the rows.
        shape: of the rows before N, (W, A) of several agents; the kernel has it flat. None: (W,).
        threads: of the kernel, such as (W, A). None: one for each world.
    """

    def __init__(
        self, batch: Batch, kernel: wp.Kernel, *arguments: Any, width: int | None, dtype: torch.dtype = torch.float32,
        shape: tuple[int, ...] | None = None, threads: tuple[int, ...] | None = None,
    ) -> None:  # fmt: skip
        worlds, row = (batch.num_worlds,), () if width is None else (width,)
        self._rows = torch.zeros(*(shape or worlds), *row, dtype=dtype, device=batch.device)
        self._launch = TensorLaunch(kernel, threads or worlds, [*arguments, self._rows.view(-1, *row)], batch.device)

    def __repr__(self) -> str:
        return f"ComputedRows: {tuple(self._rows.shape)}"

    def __call__(self) -> torch.Tensor:
        """Return the rows as they are now, the buffer itself."""
        self._launch.launch()
        return self._rows


class NamedRows:
    """A kernel whose last argument is rows (R, W), and what it writes there by name, such as terms of a reward.

    Args:
        batch: the worlds.
        kernel: with a thread for each world.
        names: of the rows.
        arguments: of the kernel but the last one; tensors may stand for arrays.
        dtype: of the rows.
        shape: of a row, (W, N) of several agents; the kernel has it flat. None: (W,).
        threads: of the kernel, such as (W, N). None: one for each world.
    """

    def __init__(
        self, batch: Batch, kernel: wp.Kernel, names: Iterable[str], *arguments: Any,
        dtype: torch.dtype = torch.float32, shape: tuple[int, ...] | None = None,
        threads: tuple[int, ...] | None = None,
    ) -> None:  # fmt: skip
        names, worlds = tuple(names), (batch.num_worlds,)
        rows = torch.zeros(len(names), *(shape or worlds), dtype=dtype, device=batch.device)
        self._named = dict(zip(names, rows, strict=True))
        self._launch = TensorLaunch(kernel, threads or worlds, [*arguments, rows.view(len(names), -1)], batch.device)

    def __repr__(self) -> str:
        return f"NamedRows: {', '.join(self._named)}"

    def __call__(self, *tensors: torch.Tensor) -> dict[str, torch.Tensor]:
        """Return the rows (W,) by name, the buffer itself.

        Args:
            tensors: first arguments of the kernel that are new ones, as for :meth:`TensorLaunch.on`.
        """
        self._launch.on(*tensors)
        return dict(self._named)


class TensorFunction:
    """A kernel as a function of tensors, whose results lie in memory of their own: callers may keep and change them.

    The kernel takes the tensors first, then what is fixed, then the results. Its threads are rows, or those and columns
    where a result has as many.

    Args:
        kernel: to launch.
        fixed: arguments between tensors and results.
        results: dtype of torch, and lengths of the dimensions after those of the threads.
        device: of the results.
        dimensions: of the threads, 1 or 2.
    """

    HOST_STATE: ClassVar[frozenset[str]] = frozenset({"_made"})
    """Launches by the shapes of tensors: made once for each."""

    def __init__(
        self, kernel: wp.Kernel, fixed: Sequence[Any], results: Sequence[tuple[torch.dtype, tuple[int, ...]]],
        device: torch.device, *, dimensions: int = 1,
    ) -> None:  # fmt: skip
        self._kernel, self._fixed, self._results = kernel, list(fixed), list(results)
        self._device, self._dimensions = device, dimensions
        self._made: dict[tuple[Any, ...], tuple[TensorLaunch, list[torch.Tensor]]] = {}

    def __repr__(self) -> str:
        return f"TensorFunction: kernel {self._kernel.key} on {self._device}"

    def __call__(self, *tensors: torch.Tensor, shape: tuple[int, ...] | None = None) -> list[torch.Tensor]:
        """Return the results, (*shape, ...).

        Args:
            tensors: first arguments of the kernel.
            shape: of the threads; by default the first dimensions of the last tensor.
        """
        size = tuple(tensors[-1].shape[: self._dimensions]) if shape is None else shape
        key = (size, *(tensor.shape for tensor in tensors))
        if key not in self._made:
            with torch.inference_mode(False):
                results = [torch.zeros(*size, *rest, dtype=dtype, device=self._device) for dtype, rest in self._results]
            arguments = [*tensors, *self._fixed, *results]
            self._made[key] = TensorLaunch(self._kernel, size, arguments, self._device), results
        launch, results = self._made[key]
        launch.on(*tensors)
        return [result.clone() for result in results]
