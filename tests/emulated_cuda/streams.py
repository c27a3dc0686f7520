"""Streams, events and captures: operations wait in the queues of their streams and run in an order that CUDA allows."""

from __future__ import annotations

import random
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

from tests.emulated_cuda.faults import Faults
from tests.emulated_cuda.settings import StreamOrder

LEGACY = 0
"""Handle of the legacy stream, with which all blocking streams synchronise."""
MOST_PENDING = 1024
"""Operations that a stream holds; the host waits where there would be more."""
NOT_READY = 600
"""CUDA's code for a query of unfinished work."""

Run = Callable[[], bool | None]


class CaptureMode(IntEnum):
    """Which calls are forbidden during a capture: of all threads, of this one, none."""

    GLOBAL = 0
    THREAD_LOCAL = 1
    RELAXED = 2


@dataclass(eq=False)
class Operation:
    """Something that a stream does.

    Attributes:
        needs: operations of other streams that come first.
        previous: operation of the same stream before it, in a capture.
        keep: objects that it uses.
        polled: a query has found it unfinished.
        marker: does nothing; only its place in the order counts.
    """

    stream: Stream
    run: Run | None
    needs: tuple[Operation, ...] = ()
    keep: tuple[Any, ...] = ()
    previous: Operation | None = None
    done: bool = False
    failed: bool = False
    polled: bool = False
    marker: bool = False


@dataclass(eq=False)
class Stream:
    """A queue of operations; `last` is the newest, done or not."""

    handle: int
    blocking: bool = True
    queue: deque[Operation] = field(default_factory=deque)
    last: Operation | None = None
    capture: Capture | None = None


@dataclass(eq=False)
class Event:
    """A mark in a stream: its operation, the capture in which it was recorded, and when it ran."""

    operation: Operation | None = None
    capture: Capture | None = None
    time: float = 0.0


@dataclass(eq=False)
class Capture:
    """Operations of a graph, while they are recorded and afterwards.

    Attributes:
        blocks: addresses of memory that belongs to the graph.
    """

    handle: int
    origin: Stream
    mode: CaptureMode
    valid: bool = True
    operations: list[Operation] = field(default_factory=list)
    streams: list[Stream] = field(default_factory=list)
    last: dict[int, Operation] = field(default_factory=dict)
    blocks: list[int] = field(default_factory=list)

    def add(self, operation: Operation) -> None:
        """Record an operation."""
        handle = operation.stream.handle
        operation.previous = self.last.get(handle)
        self.last[handle] = operation
        self.operations.append(operation)

    def unjoined(self) -> bool:
        """Whether a stream did work for which the origin does not wait."""
        found: set[int] = set()
        left = [self.last.get(self.origin.handle)]
        while left:
            operation = left.pop()
            if operation is not None and id(operation) not in found:
                found.add(id(operation))
                left += [operation.previous, *operation.needs]
        return any(id(each) not in found for each in self.operations if not each.marker)

    def replay(self, rng: random.Random | None) -> bool:
        """Run all operations, in their order or in another that their dependencies allow; False where one failed."""
        if rng is None:
            return all(each.run is None or each.run() is not False for each in self.operations)
        queues: dict[int, deque[Operation]] = {}
        for each in self.operations:
            queues.setdefault(each.stream.handle, deque()).append(each)
        done: set[int] = set()
        while queues:
            ready = [key for key, queue in queues.items() if all(id(need) in done for need in queue[0].needs)]
            key = rng.choice(ready)
            operation = queues[key].popleft()
            done.add(id(operation))
            if not queues[key]:
                del queues[key]
            if operation.run is not None and operation.run() is False:
                return False
        return True


class Streams:
    """All streams of the device.

    Attributes:
        current: handle of Warp's current stream.
        torch_current: handle of torch's current stream.
        captures: that go on, by handle.
    """

    def __init__(self, faults: Faults, order: StreamOrder, seed: int) -> None:
        self.faults, self.order = faults, order
        self.rng = random.Random(seed)
        self.legacy = Stream(LEGACY)
        self._streams = {LEGACY: self.legacy}
        self._handles = iter(range(0x1000, 1 << 40, 16))
        self._releases: list[tuple[tuple[Operation, ...], Callable[[], None]]] = []
        self._after_captures: list[Callable[[], None]] = []
        self.current = LEGACY
        self.torch_current = LEGACY
        self.captures: dict[int, Capture] = {}

    def handle(self) -> int:
        """A number that no other stream, event, graph, module or kernel has."""
        return next(self._handles)

    def create(self, *, blocking: bool) -> Stream:
        """A new stream."""
        return self.at(self.handle(), blocking=blocking)

    def at(self, handle: int, *, blocking: bool = True) -> Stream:
        """The stream of a handle, which may be another library's."""
        return self._streams.setdefault(handle, Stream(handle, blocking))

    def remove(self, handle: int) -> None:
        """Forget a stream; what it has to do is done first."""
        stream = self._streams.get(handle)
        if stream is not None and stream is not self.legacy:
            self.finish_streams([stream])
            del self._streams[handle]

    def capture_of(self, handle: int) -> Capture | None:
        """The capture that a stream is part of."""
        return self.at(handle).capture

    def submit(
        self, handle: int, run: Run | None, where: str, *, keep: Iterable[Any] = (), needs: tuple[Operation, ...] = ()
    ) -> bool:
        """Queue an operation, or record it where the stream is being captured; False where that is an error."""
        operation = self.queue(handle, run, where, keep=keep, needs=needs)
        return operation is not None and not operation.failed

    def queue(
        self, handle: int, run: Run | None, where: str, *, keep: Iterable[Any] = (), needs: tuple[Operation, ...] = ()
    ) -> Operation | None:
        """As `submit`; the operation, or None where it is an error."""
        if self.faults.sticky:
            self.faults.fail(self.faults.sticky, where, "an earlier launch failed")
            return None
        stream = self.at(handle)
        capture = stream.capture
        operation = Operation(stream, run, needs, tuple(keep), marker=run is None)
        if capture is not None:
            if not capture.valid:
                self.faults.fail(901, where)
                return None
            capture.add(operation)
            self.faults.counts["recorded"] += run is not None
            return operation
        if stream is self.legacy and self.legacy_is_barred():
            self.invalidate()
            self.faults.fail(906, where)
            return None
        operation.needs += tuple(self._implicit_needs(stream))
        stream.queue.append(operation)
        stream.last = operation
        self._advance(operation)
        return operation

    def _implicit_needs(self, stream: Stream) -> Iterator[Operation]:
        """The legacy stream waits for all blocking streams, and they for it."""
        others = self._streams.values() if stream is self.legacy else [self.legacy] if stream.blocking else []
        for other in others:
            if other is not stream and other.blocking and other.queue:
                yield other.queue[-1]

    def legacy_is_barred(self) -> bool:
        """Whether work on the legacy stream would depend on one that is being captured."""
        captures = self.captures.values()
        return any(stream.blocking for each in captures if each.valid for stream in each.streams)

    def _advance(self, operation: Operation) -> None:
        if self.order is StreamOrder.EAGER:
            self.finish(operation)
        elif self.order is StreamOrder.RANDOM:
            while self.rng.random() < 0.6:
                busy = [each for each in self._streams.values() if each.queue]
                if not busy:
                    return
                self.finish(self.rng.choice(busy).queue[0])
        elif len(operation.stream.queue) > MOST_PENDING:
            self.finish(operation.stream.queue[0])

    def finish(self, target: Operation) -> None:
        """Run an operation, what stands before it in its stream, and what that needs."""
        stack = [target]
        while stack:
            operation = stack[-1]
            if operation.done:
                stack.pop()
                continue
            head = operation.stream.queue[0]
            missing = next((each for each in head.needs if not each.done), None)
            if missing is not None:
                stack.append(missing)
                continue
            operation.stream.queue.popleft()
            run, head.run, head.needs, head.done = head.run, None, (), True
            if run is not None and not self.faults.sticky:
                head.failed = run() is False
            head.keep = ()
        self._release()

    def finish_streams(self, streams: Iterable[Stream]) -> None:
        """Run all that these streams have to do; in an order of the seed where several are free to go first."""
        left = [each for each in streams if each.queue]
        if self.order is not StreamOrder.EAGER:
            self.rng.shuffle(left)
        for stream in left:
            if stream.queue:
                self.finish(stream.queue[-1])
        self._release()

    def finish_all(self) -> None:
        """Run all that was asked for."""
        self.finish_streams(list(self._streams.values()))

    def finish_stream(self, handle: int) -> None:
        """Run what a stream has to do; the legacy stream's work includes that of blocking streams."""
        stream = self.at(handle)
        blocking = [each for each in self._streams.values() if each.blocking]
        self.finish_streams(blocking if stream is self.legacy else [stream])

    def query(self, operation: Operation | None) -> int:
        """0 where an operation is done. One that is not is done at the second query, so that a loop ends."""
        if operation is None or operation.done:
            return 0
        if operation.polled:
            self.finish(operation)
            return 0
        operation.polled = True
        return NOT_READY

    def release_later(self, release: Callable[[], None], needs: Iterable[Operation | None] | None = None) -> None:
        """Give memory back when some operations are done: by default all that were asked for, as cudaFreeAsync does on
        the legacy stream, without making it a point at which streams meet.
        """
        if self.captures:
            self._after_captures.append(release)
            return
        if needs is None:
            needs = [each.last for each in self._streams.values() if each.blocking]
        self._releases.append((tuple(each for each in needs if each is not None and not each.done), release))
        self._release()

    def _release(self) -> None:
        if not self._releases:
            return
        ready = [release for needs, release in self._releases if all(each.done for each in needs)]
        self._releases = [each for each in self._releases if not all(need.done for need in each[0])]
        for release in ready:
            release()

    def invalidate(self) -> None:
        """End all captures with an error."""
        for capture in self.captures.values():
            capture.valid = False

    def is_forbidden(self, where: str) -> bool:
        """Whether a capture forbids a call that waits or allocates; that is an error."""
        if any(capture.mode is not CaptureMode.RELAXED for capture in self.captures.values()):
            self.invalidate()
            self.faults.fail(900, where)
            return True
        return False

    def record_event(self, event: Event, handle: int, where: str, *, external: bool = False) -> None:
        """Mark a place in a stream."""

        def run() -> None:
            event.time = time.perf_counter()

        capture = self.capture_of(handle)
        event.operation = self.queue(handle, run, where)
        if event.operation is not None:
            event.operation.marker = True
        event.capture = None if external else capture

    def wait_event(self, event: Event, handle: int, where: str, *, external: bool = False) -> None:
        """What a stream does from now on comes after an event."""
        stream, needed = self.at(handle), event.operation
        if needed is None:
            return
        if event.capture is not None and event.capture.handle in self.captures:
            if stream.capture is None and stream is self.legacy:
                self.invalidate()
                self.faults.fail(906, where)
                return
            if stream.capture is None:
                stream.capture = event.capture
                event.capture.streams.append(stream)
            elif stream.capture is not event.capture:
                self.invalidate()
                self.faults.fail(902, where)
                return
        elif stream.capture is not None:
            if not external:
                self.invalidate()
                self.faults.fail(905, where, "a captured stream waits for an event that is not captured")
            return
        self.queue(handle, None, where, needs=(needed,))

    def wait_stream(self, handle: int, other: int, where: str) -> None:
        """What a stream does from now on comes after what another one was asked for until now."""
        event = Event()
        self.record_event(event, other, where)
        self.wait_event(event, handle, where)

    def begin_capture(self, handle: int, mode: CaptureMode) -> Capture:
        """Record what a stream is asked for, until `end_capture`."""
        stream = self.at(handle)
        capture = Capture(self.handle(), stream, mode, streams=[stream])
        self.captures[capture.handle] = capture
        stream.capture = capture
        return capture

    def end_capture(self, capture: Capture, where: str) -> bool:
        """End a capture; False where it failed."""
        if capture.valid and capture.unjoined():
            capture.valid = False
            self.faults.fail(904, where)
        elif not capture.valid:
            self.faults.fail(901, where)
        for stream in capture.streams:
            stream.capture = None
        self.captures.pop(capture.handle, None)
        if not self.captures:
            waiting, self._after_captures = self._after_captures, []
            for release in waiting:
                self.release_later(release)
        return capture.valid

    def launch(self, capture: Capture, handle: int, where: str) -> bool:
        """Replay a capture in a stream."""
        rng = None if self.order is StreamOrder.EAGER else self.rng
        return self.submit(handle, lambda: capture.replay(rng), where, keep=(capture,))
