"""torch's operators on the emulated device: they run on the CPU now, wait in a stream, or are recorded in a capture."""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import torch
from torch.utils._python_dispatch import TorchDispatchMode, _disable_current_modes, return_and_correct_aliasing
from torch.utils._pytree import tree_map

from tests.emulated_cuda.device import device
from tests.emulated_cuda.faults import ERRORS, caller
from tests.emulated_cuda.settings import StreamOrder
from tests.emulated_cuda.streams import LEGACY
from tests.emulated_cuda.torch_calls.torch_tensor import HOST, CudaTensor, allocating_in, borrowed, device_address

aten = torch.ops.aten
WAITING = {
    aten._local_scalar_dense.default, aten.nonzero.default, aten.equal.default, aten.masked_select.default,
    aten._unique2.default, aten.unique_dim.default, aten.unique_consecutive.default, aten.repeat_interleave.Tensor,
    aten.is_nonzero.default, aten.bincount.default, aten.nonzero_numpy.default, aten.histc.default,
}  # fmt: skip
"""Operators of which the host needs the result."""
INDEXING = ("aten::index", "aten::index_put_", "aten::_index_put_impl_", "aten::index_put")
OF_TWO_DEVICES = (*INDEXING, "aten::set_", "aten::lift_fresh")
INDEX_TYPES = (torch.bool, torch.int64, torch.int32, torch.uint8)
CHANGES_SHAPE = ("aten::set_", "aten::resize_", "aten::_unsafe_view", "aten::broadcast_tensors")
"""Operators that are about the tensor and not its values, so that they never wait."""
RANDOM_OF_VALUES = ("aten::bernoulli", "aten::multinomial", "aten::poisson", "aten::normal", "aten::native_dropout")
"""Random operators whose results depend on the values of tensors."""

Arguments = Sequence[Any]
Options = dict[str, Any]


class Mode(TorchDispatchMode):
    """Sees operators that make tensors on `cuda`."""

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return dispatch(func, args, kwargs or {})


@contextlib.contextmanager
def on_host() -> Iterator[None]:
    """Operators run on tensors of the host as ever."""
    with torch.inference_mode(False), torch.no_grad(), _disable_current_modes():
        yield


def tensors_of(tree: Any) -> list[torch.Tensor]:
    """All tensors in nested lists, tuples and dictionaries."""
    found: list[torch.Tensor] = []
    tree_map(lambda value: found.append(value) if isinstance(value, torch.Tensor) else None, tree)
    return found


def capturing() -> bool:
    """Whether torch's current stream is being captured."""
    streams = device().streams
    return streams.capture_of(streams.torch_current) is not None


def refuse(code: int, what: str, where: str) -> None:
    """End all captures with an error of CUDA.

    Raises:
        RuntimeError: always.
    """
    device().streams.invalidate()
    device().faults.fail(code, what, where)
    raise RuntimeError(f"CUDA error: {ERRORS[code]} ({what} at {where})")


def wait(what: str) -> None:
    """The host waits for torch's current stream.

    Raises:
        RuntimeError: a capture forbids it, or a launch has failed.
    """
    target, where = device(), caller()
    target.faults.waits[f"{what} at {where}"] += 1
    if capturing():
        refuse(900, what, where)
    if target.streams.torch_current == LEGACY and target.streams.legacy_is_barred():
        refuse(906, what, where)
    target.streams.finish_stream(target.streams.torch_current)
    if target.failed(what):
        raise RuntimeError(f"CUDA error: {ERRORS[target.faults.sticky]} ({what} at {where})")


def dispatch(func: Any, args: Arguments, kwargs: Options) -> Any:
    """Run an operator that may touch the device."""
    tensors = tensors_of((args, kwargs))
    found = [each for each in tensors if isinstance(each, CudaTensor)]
    wanted = torch.device(kwargs["device"]) if kwargs.get("device") is not None else None
    to_cuda = wanted is not None and wanted.type == "cuda"
    if not found and not to_cuda:
        return func(*args, **kwargs)
    if to_cuda and wanted is not None and (wanted.index or 0) != 0:
        raise RuntimeError("CUDA error: invalid device ordinal")
    result_on_device = to_cuda or wanted is None
    kwargs = dict(kwargs)
    if wanted is not None:
        kwargs["device"] = torch.device("cpu")
    if to_cuda and kwargs.get("pin_memory"):
        raise RuntimeError("Only dense CPU tensors can be pinned")
    target = device()
    target.release_given_up()
    _check_legacy(func)
    waited = _waited(func, args, kwargs, result_on_device)
    host = [each for each in tensors if not isinstance(each, CudaTensor) and each.dim() > 0]
    _check_devices(func, host, found)
    is_view = func.is_view or func._schema.name in CHANGES_SHAPE or torch.Tag.inplace_view in func.tags
    inner_args, inner_kwargs = tree_map(
        lambda each: each.host_tensor if isinstance(each, CudaTensor) else each, (args, kwargs)
    )
    stream = target.streams.torch_current if result_on_device else HOST
    with torch.inference_mode(False), torch.no_grad(), allocating_in(stream):
        out = func(*inner_args, **inner_kwargs) if is_view else _run(func, inner_args, inner_kwargs, waited)
    if not result_on_device:
        return out
    return _wrap(func, args, kwargs, out, found)


def _wrap(func: Any, args: Arguments, kwargs: Options, out: Any, found: list[CudaTensor]) -> Any:
    """Results as tensors of the device."""
    inputs = {id(each.host_tensor): each for each in found}

    def wrap(value: Any) -> Any:
        if not isinstance(value, torch.Tensor) or isinstance(value, CudaTensor):
            return value
        return inputs[id(value)] if id(value) in inputs else CudaTensor(value)

    ordinary_view = func.is_view and found and torch.is_inference_mode_enabled() and not found[0].is_inference()
    # A view of an ordinary tensor is an ordinary tensor, also in inference mode
    with torch.inference_mode(False) if ordinary_view else contextlib.nullcontext():
        out = tree_map(wrap, out)
    if func._schema.is_mutable or func.is_view:
        return return_and_correct_aliasing(func, args, kwargs, out)
    return out


def _check_legacy(func: Any) -> None:
    streams = device().streams
    if streams.torch_current == LEGACY and streams.legacy_is_barred():
        refuse(906, func._schema.name, caller())


def _check_devices(func: Any, host: list[torch.Tensor], found: list[CudaTensor]) -> None:
    name = func._schema.name
    if not host or not found or func in (aten.copy_.default, aten._to_copy.default):
        return
    if name not in OF_TWO_DEVICES or any(each.dtype not in INDEX_TYPES for each in host if name in INDEXING):
        raise RuntimeError(
            "Expected all tensors to be on the same device, but found at least two devices, cuda:0 and cpu! "
            f"({name} at {caller()})"
        )
    wait("index that lies on the host")


def _waited(func: Any, args: Arguments, kwargs: Options, result_on_device: bool) -> bool:
    """Let the host wait for what it needs: numbers, shapes, copies of memory that is not pinned. Whether it waited."""
    name = func._schema.name
    if func in WAITING:
        wait(name)
        return True
    if name in INDEXING:
        masks = [each for each in args[1] if each is not None and each.dtype in (torch.bool, torch.uint8)]
        if masks and (name == "aten::index" or args[2].numel() != 1):
            wait(f"{name} with a mask")
            return True
    if func not in (aten._to_copy.default, aten.copy_.default):
        return False
    is_new = func is aten._to_copy.default
    source = args[0] if is_new else args[1]
    from_device = isinstance(source, CudaTensor)
    to_device = result_on_device if is_new else isinstance(args[0], CudaTensor)
    if from_device == to_device or not source.numel():
        return False
    asynchronous = kwargs.get("non_blocking") or (not is_new and len(args) > 2 and args[2])
    # What torch makes for an asynchronous copy to the host is pinned
    pinned = (is_new or args[0].is_pinned()) if from_device else source.is_pinned()
    if asynchronous and pinned:
        return False
    wait("copy to the host" if from_device else "copy from the host")
    return True


def _run(func: Any, args: Arguments, kwargs: Options, waited: bool) -> Any:
    """Run an operator on the host's view: now, in the queue of torch's stream, or in its capture."""
    target = device()
    streams = target.streams
    captured = capturing()
    if not captured and (waited or streams.order is StreamOrder.EAGER):
        return func(*args, **kwargs)
    random = torch.Tag.nondeterministic_seeded in func.tags
    if random and not captured:
        if func._schema.name in RANDOM_OF_VALUES or len(tensors_of((args, kwargs))) > 1:
            streams.finish_stream(streams.torch_current)
            return func(*args, **kwargs)
        return _queue_random(func, args, kwargs)
    plan = _mutable if func._schema.is_mutable else _functional
    out, run = plan(func, args, kwargs, keep=captured)
    name = func._schema.name
    target.faults.counts["torch recorded" if captured else "torch queued"] += 1
    if not streams.submit(streams.torch_current, run, name):
        raise RuntimeError(f"CUDA error: {target.faults.last_error.decode()} ({name} at {caller()})")
    return out


def _call(func: Any, args: Arguments, kwargs: Options, results: list[torch.Tensor] | None) -> bool:
    """Run a queued operator and copy its results to where they were promised; False where memory is gone."""
    stale = [each for each in tensors_of((args, kwargs, results)) if not _is_there(each)]
    if stale:
        address = device_address(stale[0].untyped_storage().data_ptr())
        device().faults.sticky = 700
        device().faults.fail(
            700, func._schema.name, f"memory of a tensor at 0x{address:x} was given back before it ran"
        )
        return False
    with on_host(), allocating_in(HOST):
        again = func(*args, **kwargs)
        for old, new in zip(results or (), tensors_of(again) if results else (), strict=True):
            old.copy_(new)
    return True


def _is_there(tensor: torch.Tensor) -> bool:
    address = tensor.data_ptr()
    known = device_address(address)
    return known == address or not tensor.numel() or device().is_valid(known, tensor.element_size())


def _functional(func: Any, args: Arguments, kwargs: Options, *, keep: bool) -> tuple[Any, Callable[[], bool]]:
    """Results have their shapes now, hold NaN, and get their values when the operator runs."""
    try:
        shapes = _on_meta(func, args, kwargs)
    except (NotImplementedError, RuntimeError):  # no shape function: of the values that are there
        state = torch.get_rng_state()
        shapes = func(*args, **kwargs)
        torch.set_rng_state(state)
    made: list[torch.Tensor] = []

    def promise(like: Any) -> Any:
        if not isinstance(like, torch.Tensor):
            return like
        tensor = torch.empty_strided(like.size(), like.stride(), dtype=like.dtype, device="cpu")
        if tensor.numel():
            poison = 1 if tensor.dtype is torch.bool else 0xFF
            storage = tensor.untyped_storage()
            ctypes.memset(storage.data_ptr(), poison, storage.nbytes())
        made.append(tensor)
        return tensor

    out = tree_map(promise, shapes)
    held_args, held_kwargs, results = (args, kwargs, made) if keep else tree_map(_borrow, (args, kwargs, made))
    return out, lambda: _call(func, held_args, held_kwargs, results)


def _mutable(func: Any, args: Arguments, kwargs: Options, *, keep: bool) -> tuple[Any, Callable[[], bool]]:
    """In-place operators change nothing until they run."""
    held_args, held_kwargs = (args, kwargs) if keep else tree_map(_borrow, (args, kwargs))
    schema = func._schema
    names = [each.name for each in schema.arguments if each.alias_info is not None and each.alias_info.is_write]
    position = {each.name: index for index, each in enumerate(schema.arguments)}
    written = [kwargs[name] if name in kwargs else args[position[name]] for name in names]
    out = None if not schema.returns else written[0] if len(schema.returns) == 1 else tuple(written)
    return out, lambda: _call(func, held_args, held_kwargs, None)


def _queue_random(func: Any, args: Arguments, kwargs: Options) -> Any:
    """Numbers are drawn in the order of the calls, as on a GPU; they arrive when the stream comes to them."""
    streams = device().streams
    with allocating_in(HOST):
        if not func._schema.is_mutable:
            drawn = func(*args, **kwargs)
        else:
            drawn = torch.empty_like(args[0])
            func(drawn, *args[1:], **kwargs)
    to = args[0] if func._schema.is_mutable else torch.empty_strided(drawn.size(), drawn.stride(), dtype=drawn.dtype)
    held = borrowed(to)
    streams.submit(streams.torch_current, lambda: _call(aten.copy_.default, (held, drawn), {}, None), func._schema.name)
    return to


def _borrow(value: Any) -> Any:
    return borrowed(value) if isinstance(value, torch.Tensor) else value


def _on_meta(func: Any, args: Arguments, kwargs: Options) -> Any:
    """Shapes of an operator's results, without values."""

    def without_values(value: Any) -> Any:
        if not isinstance(value, torch.Tensor):
            return value
        return torch.empty_strided(value.size(), value.stride(), dtype=value.dtype, device="meta")

    meta_args, meta_kwargs = tree_map(without_values, (args, kwargs))
    makes = not tensors_of((args, kwargs)) and any(each.name == "device" for each in func._schema.arguments)
    if makes or "device" in meta_kwargs:
        meta_kwargs["device"] = torch.device("meta")
    meta_kwargs.pop("generator", None)
    return func(*meta_args, **meta_kwargs)
