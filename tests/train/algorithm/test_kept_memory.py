"""Memory that learning frees and asks for again is not handed to the system in between."""

import subprocess
import sys

import pytest

from simwarp.train.algorithm.kept_memory import keep_freed_memory

PAGES = 2 * (11 + 6 + 3 + 1 + 6 + 11) * 2**20 // 4096
"""Of the tensors of one round of the script below."""
SCRIPT = """
import resource, sys, threading
import torch
from simwarp.train.algorithm.kept_memory import keep_freed_memory

def work():
    for size in (11, 6, 3, 1, 6, 11):
        first = torch.ones(size * 2**18)
        second = first + 1.0
        del first
    return float(second[-1])

def count():
    for _ in range(30):
        work()
    before = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt
    for _ in range(5):
        assert work() == 2.0
    print(resource.getrusage(resource.RUSAGE_THREAD).ru_minflt - before)

if sys.argv[1] == "keep":
    assert keep_freed_memory()
thread = threading.Thread(target=count)
thread.start()
thread.join()
"""


def faults(word):
    """Return how many pages a thread touched that the system had to fill, over five rounds."""
    found = subprocess.run([sys.executable, "-c", SCRIPT, word], capture_output=True, text=True, check=True)
    return int(found.stdout)


@pytest.mark.skipif(not keep_freed_memory(), reason="no C library that can be told to keep memory")
def test_a_thread_gets_the_same_pages_again():
    assert faults("leave") > PAGES  # what it does by itself, so that the script can show a difference
    # A hundredth of one round: what Python's own small objects may take
    assert faults("keep") < PAGES // 100
