"""torch.cuda's streams, events and graphs on the emulated device."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

from tests.emulated_cuda.device import device
from tests.emulated_cuda.faults import ERRORS, caller
from tests.emulated_cuda.streams import LEGACY, Capture, CaptureMode, Event as DeviceEvent
from tests.emulated_cuda.torch_calls.torch_dispatch import capturing, refuse, wait
from tests.emulated_cuda.torch_calls.torch_tensor import CUDA

MODES = {"global": CaptureMode.GLOBAL, "thread_local": CaptureMode.THREAD_LOCAL, "relaxed": CaptureMode.RELAXED}


class Stream:
    """torch.cuda.Stream: one that does not synchronise with the legacy stream."""

    device_type = 1

    def __init__(self, device: Any = None, priority: int = 0, *, handle: int | None = None) -> None:
        self.device = CUDA
        self.device_index = 0
        self.cuda_stream = _new_stream() if handle is None else handle

    def synchronize(self) -> None:
        """Wait for it."""
        target, where = device(), "cudaStreamSynchronize"
        if target.streams.capture_of(self.cuda_stream) is not None:
            refuse(900, where, caller())
        target.faults.counts["synchronisations"] += 1
        target.release_given_up()
        target.streams.finish_stream(self.cuda_stream)
        _raise_if_failed(where)

    def query(self) -> bool:
        """Whether it has nothing to do."""
        streams = device().streams
        if streams.capture_of(self.cuda_stream) is not None:
            refuse(900, "cudaStreamQuery", caller())
        queue = streams.at(self.cuda_stream).queue
        return streams.query(queue[-1] if queue else None) == 0

    def wait_stream(self, stream: Stream) -> None:
        """What it does from now on comes after what another stream was asked for."""
        device().streams.wait_stream(self.cuda_stream, stream.cuda_stream, "cudaStreamWaitEvent")

    def wait_event(self, event: Event) -> None:
        """What it does from now on comes after an event."""
        event.wait(self)

    def record_event(self, event: Event | None = None) -> Event:
        """Mark a place in it."""
        event = event or Event()
        event.record(self)
        return event

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Stream) and other.cuda_stream == self.cuda_stream

    def __hash__(self) -> int:
        return hash(self.cuda_stream)


def _new_stream() -> int:
    return device().streams.create(blocking=False).handle


def _raise_if_failed(where: str) -> None:
    target = device()
    if target.failed(where):
        raise RuntimeError(f"CUDA error: {ERRORS[target.faults.sticky]} ({where} at {caller()})")


class Event:
    """torch.cuda.Event."""

    def __init__(
        self, enable_timing: bool = False, blocking: bool = False, interprocess: bool = False, external: bool = False
    ) -> None:
        self._event = DeviceEvent()
        self._external = external

    def record(self, stream: Stream | None = None) -> None:
        """Mark a place in a stream, the current one by default."""
        handle = (stream or current_stream()).cuda_stream
        device().streams.record_event(self._event, handle, "cudaEventRecord", external=self._external)

    def wait(self, stream: Stream | None = None) -> None:
        """What a stream does from now on, the current one by default, comes after this."""
        handle = (stream or current_stream()).cuda_stream
        streams = device().streams
        streams.wait_event(self._event, handle, "cudaStreamWaitEvent", external=self._external)

    def _check_capture(self, where: str) -> None:
        if self._event.capture is not None and self._event.capture.handle in device().streams.captures:
            refuse(907, where, caller())

    def synchronize(self) -> None:
        """Wait for it."""
        self._check_capture("cudaEventSynchronize")
        if self._event.operation is not None:
            device().streams.finish(self._event.operation)
        _raise_if_failed("cudaEventSynchronize")

    def query(self) -> bool:
        """Whether it has been reached."""
        self._check_capture("cudaEventQuery")
        return device().streams.query(self._event.operation) == 0

    def elapsed_time(self, end_event: Event) -> float:
        """Milliseconds to another event; of this computer, not of a GPU."""
        return 1e3 * (end_event._event.time - self._event.time)


_streams: dict[int, Stream] = {}


def default_stream(device: Any = None) -> Stream:
    """The legacy stream."""
    return Stream(handle=LEGACY)


def external_stream(handle: int, device: Any = None) -> Stream:
    """A stream of another library."""
    return Stream(handle=handle)


def current_stream(device_: Any = None) -> Stream:
    """torch's current stream."""
    handle = device().streams.torch_current
    return _streams.setdefault(handle, Stream(handle=handle))


def set_stream(stream: Stream) -> None:
    """Set torch's current stream."""
    _streams[stream.cuda_stream] = stream
    device().streams.torch_current = stream.cuda_stream


@contextlib.contextmanager
def stream_context(stream: Stream | None) -> Iterator[None]:
    """torch.cuda.stream: operators inside go to a stream."""
    before = current_stream()
    if stream is not None:
        set_stream(stream)
    try:
        yield
    finally:
        set_stream(before)


class CUDAGraph:
    """torch.cuda.CUDAGraph."""

    def __init__(self, keep_graph: bool = False) -> None:
        self._capture: Capture | None = None

    def capture_begin(self, pool: Any = None, capture_error_mode: str = "global") -> None:
        """Record the current stream from now on."""
        streams = device().streams
        handle = streams.torch_current
        if handle == LEGACY:
            raise RuntimeError("CUDA graphs must be captured on a non-default stream.")
        self._capture = streams.begin_capture(handle, MODES[capture_error_mode])
        device().faults.counts["torch captures"] += 1

    def capture_end(self) -> None:
        """End the capture."""
        if self._capture is not None and not device().streams.end_capture(self._capture, "cudaStreamEndCapture"):
            raise RuntimeError(f"CUDA error: {device().faults.last_error.decode()}")

    def replay(self) -> None:
        """Run what was recorded, in the current stream."""
        target = device()
        target.faults.counts["torch replays"] += 1
        target.release_given_up()
        if self._capture is None:
            raise RuntimeError("Called CUDAGraph::replay without a preceding successful capture.")
        if not target.streams.launch(self._capture, target.streams.torch_current, "cudaGraphLaunch"):
            raise RuntimeError(f"CUDA error: {target.faults.last_error.decode()}")

    def reset(self) -> None:
        """Give the graph back."""
        if not device().streams.captures:
            device().streams.finish_all()
        self._capture = None

    def pool(self) -> tuple[int, int]:
        """Memory that graphs may share."""
        return (0, 0)


class graph:
    """torch.cuda.graph: what is inside is recorded into a graph."""

    def __init__(
        self, cuda_graph: CUDAGraph, pool: Any = None, stream: Stream | None = None, capture_error_mode: str = "global"
    ) -> None:
        self._graph, self._mode = cuda_graph, capture_error_mode
        self._stream = stream if stream is not None else Stream()

    def __enter__(self) -> None:
        synchronize()
        self._before = current_stream()
        set_stream(self._stream)
        self._graph.capture_begin(capture_error_mode=self._mode)

    def __exit__(self, *error: object) -> None:
        try:
            self._graph.capture_end()
        finally:
            set_stream(self._before)


def synchronize(device_: Any = None) -> None:
    """Wait for all streams."""
    target = device()
    if capturing():
        wait("torch.cuda.synchronize")
    if not target.synchronize("cudaDeviceSynchronize"):
        raise RuntimeError(f"CUDA error: {target.faults.last_error.decode()}")
