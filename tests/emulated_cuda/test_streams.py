"""Order of operations in streams, and the rules of captures, with operations that note when they run."""

from __future__ import annotations

import pytest

from tests.emulated_cuda.faults import Faults
from tests.emulated_cuda.settings import StreamOrder
from tests.emulated_cuda.streams import LEGACY, MOST_PENDING, NOT_READY, CaptureMode, Event, Streams

GLOBAL = CaptureMode.GLOBAL


class Log:
    """Streams of one order, and the names of operations in the order in which they ran."""

    def __init__(self, order: StreamOrder, seed: int = 1) -> None:
        self.faults = Faults(trace=False)
        self.faults.printing = False
        self.streams = Streams(self.faults, order, seed)
        self.ran: list[str] = []

    def stream(self, *, blocking: bool = False) -> int:
        """A new stream."""
        return self.streams.create(blocking=blocking).handle

    def do(self, stream: int, name: str) -> bool:
        """Queue an operation that notes its name."""
        return self.streams.submit(stream, lambda: self.ran.append(name), name)

    def codes(self) -> list[int]:
        """Codes of the faults."""
        return [int(text.split("error ")[1].split(":")[0]) for text, _ in self.faults.violations]


@pytest.fixture
def lazy_log():
    """Streams that run as late as they may."""
    return Log(StreamOrder.LAZY)


def test_eager_streams_run_in_the_order_of_the_calls():
    log = Log(StreamOrder.EAGER)
    a, b = log.stream(), log.stream()
    for stream, name in ((a, "1"), (b, "2"), (a, "3")):
        assert log.do(stream, name)
    assert log.ran == ["1", "2", "3"]


def test_lazy_streams_run_when_someone_waits(lazy_log):
    log = lazy_log
    a, b = log.stream(), log.stream()
    for stream, name in ((a, "a1"), (b, "b1"), (a, "a2")):
        log.do(stream, name)
    assert log.ran == []
    log.streams.finish_stream(b)
    assert log.ran == ["b1"]
    log.streams.finish_all()
    assert log.ran == ["b1", "a1", "a2"]


def test_an_event_orders_two_streams(lazy_log):
    log = lazy_log
    a, b = log.stream(), log.stream()
    event = Event()
    log.do(a, "a1")
    log.streams.record_event(event, a, "record")
    log.do(a, "a2")
    log.do(b, "b1")
    log.streams.wait_event(event, b, "wait")
    log.do(b, "b2")
    log.streams.finish_stream(b)
    assert log.ran == ["b1", "a1", "b2"]


def test_random_streams_keep_their_own_order_and_that_of_events():
    seen = set()
    for seed in range(20):
        log = Log(StreamOrder.RANDOM, seed)
        a, b = log.stream(), log.stream()
        log.do(a, "a1")
        log.do(b, "b1")
        log.streams.wait_stream(b, a, "wait")
        log.do(b, "b2")
        log.do(a, "a2")
        log.streams.finish_all()
        assert log.ran.index("a1") < log.ran.index("a2")
        assert log.ran.index("b1") < log.ran.index("b2")
        assert log.ran.index("a1") < log.ran.index("b2")
        seen.add(tuple(log.ran))
    assert len(seen) > 2


def test_the_legacy_stream_and_blocking_streams_wait_for_each_other(lazy_log):
    log = lazy_log
    blocking, free = log.stream(blocking=True), log.stream()
    log.do(blocking, "b1")
    log.do(free, "f1")
    log.do(LEGACY, "l1")
    log.do(blocking, "b2")
    log.streams.finish_stream(blocking)
    assert log.ran == ["b1", "l1", "b2"]
    log.streams.finish_stream(LEGACY)
    assert log.ran == ["b1", "l1", "b2"]
    log.streams.finish_all()
    assert log.ran[-1] == "f1"


def test_blocking_streams_do_not_wait_for_each_other(lazy_log):
    log = lazy_log
    a, b = log.stream(blocking=True), log.stream(blocking=True)
    log.do(a, "a")
    log.do(b, "b")
    log.streams.finish_stream(b)
    assert log.ran == ["b"]


def test_a_query_says_not_ready_once(lazy_log):
    log = lazy_log
    a = log.stream()
    event = Event()
    log.do(a, "a")
    log.streams.record_event(event, a, "record")
    assert log.streams.query(event.operation) == NOT_READY
    assert log.ran == []
    assert log.streams.query(event.operation) == 0
    assert log.ran == ["a"]


def test_a_stream_holds_so_many_operations_at_most(lazy_log):
    a = lazy_log.stream()
    for index in range(MOST_PENDING + 5):
        lazy_log.do(a, str(index))
    assert lazy_log.ran == [str(index) for index in range(5)]


def test_memory_is_released_when_what_came_before_is_done(lazy_log):
    log = lazy_log
    a, free = log.stream(blocking=True), log.stream()
    log.do(a, "a")
    log.do(free, "f")
    log.streams.release_later(lambda: log.ran.append("released"))
    log.streams.finish_stream(free)
    assert log.ran == ["f"]
    log.streams.finish_stream(a)
    assert log.ran == ["f", "a", "released"]


def test_memory_is_not_released_during_a_capture(lazy_log):
    log = lazy_log
    a = log.stream()
    capture = log.streams.begin_capture(a, GLOBAL)
    log.streams.release_later(lambda: log.ran.append("released"))
    assert log.ran == []
    assert log.streams.end_capture(capture, "end")
    assert log.ran == ["released"]


@pytest.mark.parametrize("order", StreamOrder)
def test_a_capture_runs_nothing_and_a_replay_all(order):
    log = Log(order)
    a, b = log.stream(), log.stream()
    capture = log.streams.begin_capture(a, GLOBAL)
    log.do(a, "a1")
    log.streams.wait_stream(b, a, "fork")
    log.do(b, "b1")
    log.do(a, "a2")
    log.streams.wait_stream(a, b, "join")
    log.do(a, "a3")
    assert log.streams.end_capture(capture, "end")
    assert log.ran == []
    assert log.streams.capture_of(b) is None
    for _ in range(2):
        log.ran.clear()
        assert log.streams.launch(capture, a, "launch")
        log.streams.finish_all()
        assert log.ran[0] == "a1"
        assert set(log.ran[1:3]) == {"b1", "a2"}
        assert log.ran[3] == "a3"


def test_branches_of_a_graph_run_in_several_orders():
    seen = set()
    for seed in range(12):
        log = Log(StreamOrder.RANDOM, seed)
        a, b = log.stream(), log.stream()
        capture = log.streams.begin_capture(a, GLOBAL)
        log.streams.wait_stream(b, a, "fork")
        log.do(b, "b")
        log.do(a, "a")
        log.streams.wait_stream(a, b, "join")
        log.streams.end_capture(capture, "end")
        log.streams.launch(capture, a, "launch")
        log.streams.finish_all()
        seen.add(tuple(log.ran))
    assert seen == {("a", "b"), ("b", "a")}


def test_a_captured_stream_that_waits_for_uncaptured_work_is_a_fault(lazy_log):
    log = lazy_log
    a, b = log.stream(), log.stream()
    capture = log.streams.begin_capture(a, GLOBAL)
    log.do(b, "b")
    log.streams.wait_stream(a, b, "join")
    assert not log.streams.end_capture(capture, "end")
    assert log.codes() == [905, 901]


def test_work_that_the_origin_does_not_join_is_a_fault(lazy_log):
    log = lazy_log
    a, b = log.stream(), log.stream()
    capture = log.streams.begin_capture(a, GLOBAL)
    log.streams.wait_stream(b, a, "fork")
    assert log.do(b, "b")
    assert not log.streams.end_capture(capture, "end")
    assert log.codes() == [904]
    assert log.streams.capture_of(b) is None


def test_two_captures_cannot_merge(lazy_log):
    log = lazy_log
    a, b = log.stream(), log.stream()
    log.streams.begin_capture(a, GLOBAL)
    log.streams.begin_capture(b, GLOBAL)
    log.streams.wait_stream(b, a, "merge")
    assert log.codes() == [902]


def test_the_legacy_stream_is_barred_while_a_blocking_stream_is_captured(lazy_log):
    log = lazy_log
    log.streams.begin_capture(log.stream(blocking=False), GLOBAL)
    assert log.do(LEGACY, "free")
    capture = log.streams.begin_capture(log.stream(blocking=True), GLOBAL)
    assert not log.do(LEGACY, "barred")
    assert log.codes() == [906]
    assert not log.streams.end_capture(capture, "end")


def test_after_a_fault_a_capture_records_nothing(lazy_log):
    log = lazy_log
    a = log.stream()
    capture = log.streams.begin_capture(a, GLOBAL)
    assert log.streams.is_forbidden("cudaMalloc")
    assert not log.do(a, "a")
    assert not log.streams.end_capture(capture, "end")
    assert log.codes() == [900, 901, 901]


def test_a_relaxed_capture_forbids_no_calls(lazy_log):
    lazy_log.streams.begin_capture(lazy_log.stream(), CaptureMode.RELAXED)
    assert not lazy_log.streams.is_forbidden("cudaMalloc")


def test_after_a_failed_launch_nothing_runs(lazy_log):
    log = lazy_log
    a = log.stream()
    log.do(a, "a")
    log.faults.sticky = 700
    log.streams.finish_all()
    assert log.ran == []
    assert not log.do(a, "b")
    assert log.codes() == [700]
