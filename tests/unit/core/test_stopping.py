"""Requests to stop: copies count as one, a later one is another, and what is being saved is not interrupted."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from simwarp.core import stopping
from simwarp.core.stopping import StopRequest, interrupted_by_signals, stop_on_signals

ALL = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


class Clock:
    """Stands for the monotonic clock; who sleeps moves it on. It has no time by the wall, which somebody may set."""

    def __init__(self):
        self.now = 1000.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(stopping, "time", made)
    return made


@pytest.fixture(params=ALL)
def number(request):
    before = signal.getsignal(request.param)
    yield request.param
    signal.signal(request.param, before)


@pytest.fixture
def heard():
    """All signals as they are where a command starts, and afterwards as they were."""
    before = {each: signal.getsignal(each) for each in ALL}
    for each in ALL:
        signal.signal(each, signal.default_int_handler if each is signal.SIGINT else signal.SIG_DFL)
    yield
    for each, handler in before.items():
        signal.signal(each, handler)


def test_the_first_signal_asks_and_a_later_one_interrupts(number, clock):
    before = signal.getsignal(number)

    def asked_twice():
        with stop_on_signals() as request:
            signal.raise_signal(number)
            assert request.requested
            clock.sleep(stopping.COPIES_WITHIN)
            signal.raise_signal(number)

    with pytest.raises(KeyboardInterrupt):
        asked_twice()
    assert signal.getsignal(number) is before


@pytest.mark.parametrize("gap", [0.0, 0.05, 0.99])
@pytest.mark.parametrize("other", ALL)
def test_copies_within_a_second_count_as_one_whichever_signals_they_are(heard, clock, gap, other):
    with stop_on_signals() as request:
        signal.raise_signal(signal.SIGTERM)
        clock.sleep(gap)
        for _ in range(3):
            signal.raise_signal(other)
        assert (request.times, request.requested, request.at_once) == (1, True, False)
        assert request.age == pytest.approx(gap)


def test_a_stream_of_signals_is_a_request_a_second(heard, clock):
    with stop_on_signals() as request, request.saving():
        for _ in range(40):
            signal.raise_signal(signal.SIGINT)
            clock.sleep(0.0625)  # exact in binary: 2.5 s, copies but for those after 0, 1 and 2 s
        assert request.times == 3


def test_nothing_interrupts_what_is_being_saved(heard, clock):
    with stop_on_signals() as request:
        with request.saving():
            for _ in range(3):
                signal.raise_signal(signal.SIGTERM)
                clock.sleep(2.0)
            assert (request.times, request.at_once) == (3, True)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)


def test_a_copy_is_one_also_after_the_work_that_was_asked(heard, clock):
    """A fast training has saved before the copy comes; what follows, a picture and the hints, is not interrupted."""
    with interrupted_by_signals():
        with stop_on_signals() as request:
            signal.raise_signal(signal.SIGINT)
        assert request.times == 1
        clock.sleep(0.05)
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
        clock.sleep(1.0)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)


def test_without_a_command_around_it_the_handler_outlasts_the_copies(heard, clock, monkeypatch):
    """The caller's own handlers would end its program by the copy."""
    slept = []

    def sleep(seconds):
        slept.append(seconds)
        signal.raise_signal(signal.SIGTERM)  # by default it would end this process
        clock.now += seconds

    monkeypatch.setattr(clock, "sleep", sleep)
    with stop_on_signals() as request:
        signal.raise_signal(signal.SIGTERM)
        clock.now += 0.25
    assert request.times == 1
    assert slept == [0.75]
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_command_is_interrupted_once_by_copies(heard, clock):
    caught = []
    with interrupted_by_signals():
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt:
            signal.raise_signal(signal.SIGTERM)  # while it is told
            signal.raise_signal(signal.SIGINT)
            caught.append(True)
        clock.sleep(1.0)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGHUP)
    assert caught == [True]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_signal_that_is_ignored_stays_ignored(number):
    """As it is for work that a shell runs in the background."""
    signal.signal(number, signal.SIG_IGN)
    with interrupted_by_signals(), stop_on_signals() as request:
        assert signal.getsignal(number) is signal.SIG_IGN
        signal.raise_signal(number)
        assert not request.requested


def test_handlers_of_others_stay_but_for_long_work(heard):
    def theirs(number, frame):
        pass

    signal.signal(signal.SIGTERM, theirs)
    with interrupted_by_signals():
        assert signal.getsignal(signal.SIGTERM) is theirs
        with stop_on_signals() as request:
            signal.raise_signal(signal.SIGTERM)
            assert request.requested
        assert signal.getsignal(signal.SIGTERM) is theirs
    assert signal.getsignal(signal.SIGTERM) is theirs


def test_threads_do_without(heard):
    found = []

    def work():
        with interrupted_by_signals(), stop_on_signals() as request:
            found.append((request, signal.getsignal(signal.SIGTERM)))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [(StopRequest(), signal.SIG_DFL)]


COPIES = """
import os, signal, sys, threading, time
from simwarp.core.stopping import exit_at_signals, interrupted_by_signals

ready = []

def copies():
    while not ready:  # an interrupt inside `Thread.start` would leave its lock behind
        time.sleep(0.001)
    for _ in range(50):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)

with interrupted_by_signals():
    threading.Thread(target=copies).start()
    try:
        ready.append(True)
        while True:
            time.sleep(0.01)
    except KeyboardInterrupt:
        exit_at_signals(7)
        print("interrupted", flush=True)
        if len(sys.argv) > 1:
            while True:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.1)
"""


@pytest.mark.parametrize("again", [False, True])
def test_copies_do_not_end_a_process_that_tidies_up_and_a_later_signal_does(again):
    done = subprocess.run(
        [sys.executable, "-c", COPIES, *["again"] * again], capture_output=True, text=True, timeout=120,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ("interrupted\n", "")
    assert done.returncode == (7 if again else 0)


def test_requests_know_their_age(clock):
    request = StopRequest()
    assert (request.age, request.requested) == (0.0, False)
    request.ask()
    clock.sleep(2.5)
    assert request.age == 2.5
    with pytest.raises(KeyboardInterrupt):
        request.ask()
    assert request.age == 2.5
