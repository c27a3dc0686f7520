"""Requests to stop: heard once, at once the second time, and not at all where they are ignored."""

import signal

import pytest

from simwarp.train.runs.stopping import stop_on_signals


@pytest.fixture(params=[signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def number(request):
    before = signal.getsignal(request.param)
    yield request.param
    signal.signal(request.param, before)


def test_the_first_signal_asks_and_the_second_interrupts(number):
    before = signal.getsignal(number)

    def asked_twice():
        with stop_on_signals() as request:
            signal.raise_signal(number)
            assert request.requested
            signal.raise_signal(number)

    with pytest.raises(KeyboardInterrupt):
        asked_twice()
    assert signal.getsignal(number) is before


def test_a_signal_that_is_ignored_stays_ignored(number):
    """As it is for work that a shell runs in the background."""
    signal.signal(number, signal.SIG_IGN)
    with stop_on_signals() as request:
        assert signal.getsignal(number) is signal.SIG_IGN
        signal.raise_signal(number)
        assert not request.requested
