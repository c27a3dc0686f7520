"""Threads that learn: whose they are, what they inherit, and that none is left."""

import threading

import pytest
import torch

from simwarp.train.algorithm.learner_thread_pool import LearnerThreads

NAME = "simwarp-learner"


def alive():
    return [thread for thread in threading.enumerate() if thread.name.startswith(NAME)]


@pytest.fixture
def threads():
    made = LearnerThreads(3)
    yield made
    made.close()
    assert alive() == []


def test_results_come_in_the_order_of_the_arguments(threads):
    assert threads.map(lambda a, b: a - b, range(50), range(0, 100, 2)) == [-number for number in range(50)]
    assert threads.map(lambda a: a, []) == []
    with pytest.raises(ValueError, match="argument 2 is shorter"):
        threads.map(lambda a, b: a, [1, 2], [1])


def test_all_of_them_work_at_the_same_time_and_the_caller_is_one_of_them(threads):
    meet = threading.Barrier(3, timeout=30.0)

    def who(_):
        meet.wait()
        return threading.current_thread()

    for _ in range(5):
        found = threads.map(who, range(3))
        assert len(set(found)) == 3
        assert threading.current_thread() in found


def test_no_more_threads_start_than_there_is_work_for():
    threads = LearnerThreads(8)
    assert threads.map(lambda a: threading.current_thread(), [0]) == [threading.current_thread()]
    assert alive() == []
    threads.map(lambda a: a, range(3))
    assert len(alive()) <= 2
    threads.close()
    assert alive() == []


@pytest.mark.parametrize("of_the_caller", [True, False])
def test_what_one_of_them_raises_reaches_the_caller_once_all_have_stopped(threads, of_the_caller):
    caller, meet, done = threading.current_thread(), threading.Barrier(3, timeout=30.0), []

    def work(number):
        if number < 3:
            meet.wait()  # each has one of the first three
            if (threading.current_thread() is caller) == of_the_caller:
                raise ArithmeticError(f"number {number}")
        else:
            threading.Event().wait(0.01)
        done.append(number)

    with pytest.raises(ArithmeticError, match=r"number [012]"):
        threads.map(work, range(1000))
    count = len(done)
    assert count < 900
    threading.Event().wait(0.05)
    assert len(done) == count
    assert threads.map(lambda a: a + 1, range(4)) == [1, 2, 3, 4]


def test_gradients_are_kept_as_in_the_thread_of_the_caller(threads):
    meet = threading.Barrier(3, timeout=30.0)

    def modes(_):
        meet.wait()
        return torch.is_grad_enabled(), torch.is_inference_mode_enabled()

    assert threads.map(modes, range(3)) == [(True, False)] * 3
    with torch.no_grad():
        assert threads.map(modes, range(3)) == [(False, False)] * 3
    with torch.inference_mode():
        assert threads.map(modes, range(3)) == [(False, True)] * 3
    assert threads.map(modes, range(3)) == [(True, False)] * 3


def test_operations_of_torch_keep_to_their_thread_meanwhile(threads):
    meet = threading.Barrier(3, timeout=30.0)

    def count(_):
        meet.wait()
        return torch.get_num_threads()

    torch.set_num_threads(2)
    try:
        assert threads.map(count, range(3)) == [1, 1, 1]
        assert torch.get_num_threads() == 2
        with pytest.raises(ZeroDivisionError):
            threads.map(lambda number: 1 // number, [0])
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(1)
    assert threads.map(count, range(3)) == [1, 1, 1]
