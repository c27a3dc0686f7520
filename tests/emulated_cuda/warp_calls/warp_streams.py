"""Stand-ins for Warp's functions of contexts, streams and events."""

from __future__ import annotations

from typing import Any

from tests.emulated_cuda.device import Device
from tests.emulated_cuda.streams import LEGACY, Event
from tests.emulated_cuda.warp_calls.warp_arguments import number

CONTEXT = 0xC0DA
"""Handle of the only context."""


class WarpStreams:
    """Functions of streams, named as in Warp's library without `wp_`."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.streams, self.faults = device.streams, device.faults
        self._context = 0
        self._contexts: list[int] = []
        self._events: dict[int, Event] = {}

    # contexts

    def cuda_context_get_current(self) -> int | None:
        """The current context."""
        return self._context or None

    def cuda_context_set_current(self, context: Any) -> None:
        """Set it."""
        self._context = number(context)

    def cuda_context_push_current(self, context: Any) -> None:
        """Set it, until it is popped."""
        self._contexts.append(self._context)
        self._context = number(context)

    def cuda_context_pop_current(self) -> None:
        """Set the one before."""
        self._context = self._contexts.pop()

    def cuda_context_is_primary(self, context: Any) -> int:
        """There is one context."""
        return 1

    def cuda_context_get_device_ordinal(self, context: Any) -> int:
        """There is one device."""
        return 0

    def cuda_device_get_primary_context(self, ordinal: int) -> int:
        """The context."""
        self._context = CONTEXT
        return CONTEXT

    def cuda_context_get_stream(self, context: Any) -> int | None:
        """Warp's current stream."""
        return self.streams.current or None

    def cuda_context_set_stream(self, context: Any, stream: Any, sync: Any) -> None:
        """Set it; with `sync` it waits for the one before."""
        handle = number(stream)
        if sync:
            self.streams.wait_stream(handle, self.streams.current, "wp_cuda_context_set_stream")
        self.streams.current = handle

    def cuda_context_synchronize(self, context: Any) -> bool:
        """Wait for all streams."""
        return self.device.synchronize("wp_cuda_context_synchronize")

    def cuda_context_check(self, context: Any) -> int:
        """Code of a failed launch."""
        return self.faults.sticky

    # streams

    def cuda_stream_create(self, context: Any, priority: Any) -> int:
        """A stream, which synchronises with the legacy one."""
        return self.streams.create(blocking=True).handle

    def cuda_stream_destroy(self, context: Any, stream: Any) -> None:
        """Give a stream back."""
        self.streams.remove(number(stream))

    def cuda_stream_register(self, context: Any, stream: Any) -> None:
        """Know a stream of another library."""
        self.streams.at(number(stream))

    def cuda_stream_unregister(self, context: Any, stream: Any) -> None:
        """Nothing is to be forgotten."""

    def _is_idle(self, handle: int, where: str) -> bool:
        """Whether no capture forbids to wait for a stream."""
        barred = handle == LEGACY and self.streams.legacy_is_barred()
        if barred or self.streams.capture_of(handle) is not None:
            self.streams.invalidate()
            self.faults.fail(900, where)
            return False
        return True

    def cuda_stream_query(self, stream: Any) -> int:
        """0 where a stream has nothing to do."""
        handle = number(stream)
        if not self._is_idle(handle, "wp_cuda_stream_query"):
            return 900
        queue = self.streams.at(handle).queue
        return self.streams.query(queue[-1] if queue else None)

    def cuda_stream_synchronize(self, stream: Any) -> bool:
        """Wait for a stream."""
        handle, where = number(stream), "wp_cuda_stream_synchronize"
        if not self._is_idle(handle, where):
            return False
        self.faults.counts["synchronisations"] += 1
        self.streams.finish_stream(handle)
        return not self.device.failed(where)

    def cuda_stream_is_capturing(self, stream: Any) -> int:
        """Whether a stream is being captured."""
        return int(self.streams.capture_of(number(stream)) is not None)

    def cuda_stream_is_blocking(self, stream: Any) -> int:
        """Whether a stream synchronises with the legacy one."""
        return int(self.streams.at(number(stream)).blocking)

    def cuda_stream_get_capture_id(self, stream: Any) -> int:
        """Handle of a stream's capture, or 0."""
        capture = self.streams.capture_of(number(stream))
        return capture.handle if capture else 0

    def cuda_stream_get_priority(self, stream: Any) -> int:
        """All have the same one."""
        return 0

    def cuda_thread_exchange_capture_mode(self, mode: Any) -> int:
        """The mode of threads is always global."""
        return 0

    def cuda_stream_wait_event(self, stream: Any, event: Any, external: Any = False) -> None:
        """Wait for an event in a stream."""
        record = self._events[number(event)]
        self.streams.wait_event(record, number(stream), "wp_cuda_stream_wait_event", external=bool(external))

    def cuda_stream_wait_stream(self, stream: Any, other: Any, event: Any, external: Any = False) -> None:
        """Wait for another stream in a stream."""
        self.cuda_event_record(event, other, external)
        self.cuda_stream_wait_event(stream, event, external)

    # events

    def cuda_event_create(self, context: Any, flags: Any) -> int:
        """An event."""
        handle = self.streams.handle()
        self._events[handle] = Event()
        return handle

    def cuda_event_destroy(self, event: Any) -> None:
        """Give it back."""
        self._events.pop(number(event), None)

    def cuda_event_record(self, event: Any, stream: Any, external: Any = False) -> None:
        """Mark a place in a stream."""
        record = self._events[number(event)]
        self.streams.record_event(record, number(stream), "wp_cuda_event_record", external=bool(external))

    def _event(self, event: Any, where: str) -> Event | None:
        """An event that no capture keeps from being looked at."""
        record = self._events[number(event)]
        if record.capture is not None and record.capture.handle in self.streams.captures:
            self.streams.invalidate()
            self.faults.fail(907, where)
            return None
        return record

    def cuda_event_query(self, event: Any) -> int:
        """0 where it has been reached."""
        record = self._event(event, "wp_cuda_event_query")
        return 907 if record is None else self.streams.query(record.operation)

    def cuda_event_synchronize(self, event: Any) -> bool:
        """Wait for it."""
        record = self._event(event, "wp_cuda_event_synchronize")
        if record is None:
            return False
        self.faults.counts["synchronisations"] += 1
        if record.operation is not None:
            self.streams.finish(record.operation)
        return not self.faults.sticky

    def cuda_event_elapsed_time(self, begin: Any, end: Any) -> float:
        """Milliseconds between two events; of this computer, not of a GPU."""
        return 1e3 * (self._events[number(end)].time - self._events[number(begin)].time)
