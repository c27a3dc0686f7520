"""Programs with a fault each, run on the emulated device; prints as JSON what each of them saw.

`python -m tests.emulated_cuda tests/emulated_cuda/planted_faults.py [NAME ...]`
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable

import numpy as np
import torch
import warp as wp

from simwarp.kernels.core.lanes import lane_of, meet, sum_over_lanes
from tests.emulated_cuda.device import device

CUDA = "cuda:0"
PROGRAMS: dict[str, Callable[[], str]] = {}


def program(function: Callable[[], str]) -> Callable[[], str]:
    """List a program; it gives a text about what it saw, or raises."""
    PROGRAMS[function.__name__] = function
    return function


@wp.kernel
def reads_its_neighbour(a: wp.array(dtype=float), b: wp.array(dtype=float)):  # type: ignore[valid-type]
    """A race: the neighbour writes what this thread reads."""
    i = wp.tid()
    a[i] = float(i)  # type: ignore[arg-type]
    b[i] = a[(i + 1) % 64]  # type: ignore[operator]


@wp.kernel
def reads_another_lane(a: wp.array(dtype=float), b: wp.array(dtype=float), lanes: int, apart: int):  # type: ignore[valid-type]
    """Lanes that meet write a word each; then each reads the word of the lane that is `apart`."""
    i = wp.tid()
    a[i] = float(lane_of(lanes))
    meet(lanes)
    b[i] = a[i ^ apart]  # type: ignore[operator]


@wp.kernel
def changes_what_lanes_read(a: wp.array(dtype=float), b: wp.array(dtype=float), waits: int):  # type: ignore[valid-type]
    """All lanes read a word, which one of them changes then, having read it again."""
    i = wp.tid()
    b[i] = a[0]
    if waits == 1:
        meet(32)
    if i == 5:
        a[0] = a[0] + 1.0


@wp.kernel
def adds_up_lanes(a: wp.array(dtype=float), b: wp.array(dtype=float), lanes: int):  # type: ignore[valid-type]
    """Each lane gets the sum of all, where half of the groups take no part."""
    i = wp.tid()
    if (i / lanes) % 2 == 0:  # type: ignore[operator]
        b[i] = sum_over_lanes(lanes, a[i])


@wp.kernel
def doubles(a: wp.array(dtype=float), b: wp.array(dtype=float)):  # type: ignore[valid-type]
    """Free of races."""
    i = wp.tid()
    b[i] = 2.0 * a[i]


@wp.kernel
def runs_over_the_end(a: wp.array(dtype=float)):  # type: ignore[valid-type]
    """Writes behind the last element."""
    a[wp.tid() + 1] = 1.0  # type: ignore[operator]


def arrays(count: int = 64) -> tuple[wp.array, wp.array]:
    """Ones and zeros of the device."""
    return wp.ones(count, dtype=float, device=CUDA), wp.zeros(count, dtype=float, device=CUDA)


@program
def race() -> str:
    """Two threads touch a word."""
    a, b = arrays()
    wp.launch(reads_its_neighbour, dim=64, inputs=[a, b], device=CUDA)
    b.numpy()
    return f"races {device().races()[0]}"


@program
def no_race() -> str:
    """Each thread has words of its own."""
    a, b = arrays()
    wp.launch(doubles, dim=64, inputs=[a, b], device=CUDA)
    value = b.numpy()[0]  # which waits for the launch
    return f"races {device().races()[0]}, {value}"


def _races_of_lanes(lanes: int, apart: int) -> str:
    a, b = arrays()
    wp.launch(reads_another_lane, dim=64, inputs=[a, b, lanes, apart], device=CUDA, block_dim=32)
    values = b.numpy()[:8].astype(int).tolist()
    return f"races {device().races()[0]}, {values}"


@program
def lanes_that_meet() -> str:
    """Each reads what a lane has written that it has met since."""
    return _races_of_lanes(32, 16) + _races_of_lanes(8, 5)


@program
def lanes_that_do_not_meet() -> str:
    """Each thread is alone."""
    return _races_of_lanes(1, 1)


@program
def lanes_of_other_groups() -> str:
    """Lanes meet by eight, and read what the next eight write."""
    return _races_of_lanes(8, 8)


def _changed_by_a_lane(waits: int) -> str:
    a, b = arrays(32)
    wp.launch(changes_what_lanes_read, dim=32, inputs=[a, b, waits], device=CUDA, block_dim=32)
    most = b.numpy().max()  # which waits for the launch
    return f"raced {device().races()[0] > 0}, {most}"


@program
def a_lane_changes_what_all_have_read() -> str:
    """After they have met."""
    return _changed_by_a_lane(1)


@program
def a_lane_changes_what_others_read() -> str:
    """Without waiting for them."""
    return _changed_by_a_lane(0)


@program
def sums_of_lanes() -> str:
    """Groups of 4 and 32 add up ones; every second group goes another way."""
    seen = []
    for lanes in (4, 32):
        a, b = arrays()
        wp.launch(adds_up_lanes, dim=64, inputs=[a, b, lanes], device=CUDA, block_dim=32)
        seen.append(sorted(set(b.numpy().tolist())))
    return str(seen)


@program
def out_of_bounds() -> str:
    """A thread writes behind the end."""
    a, _ = arrays()
    wp.launch(runs_over_the_end, dim=64, inputs=[a], device=CUDA)
    wp.synchronize_device(CUDA)
    return "passed"


@program
def host_read_in_a_warp_capture() -> str:
    """The host reads an array while a graph is recorded."""
    a, b = arrays()
    wp.load_module(device=CUDA)
    with wp.ScopedCapture(CUDA):
        wp.launch(doubles, dim=64, inputs=[a, b], device=CUDA)
        b.numpy()
    return "passed"


@program
def host_read_in_a_torch_capture() -> str:
    """The host reads a tensor while a graph is recorded."""
    x = torch.ones(4, device=CUDA)
    with torch.cuda.graph(torch.cuda.CUDAGraph()):
        float((x + 1).sum())
    return "passed"


@program
def legacy_stream_in_a_capture() -> str:
    """Work goes to the legacy stream while a blocking one is captured."""
    a, b = arrays()
    wp.load_module(device=CUDA)
    with wp.ScopedCapture(CUDA, stream=wp.Stream(CUDA)):
        wp.launch(doubles, dim=64, inputs=[a, b], device=CUDA, stream=wp.get_device(CUDA).null_stream)
    return "passed"


@program
def allocation_in_a_capture() -> str:
    """cudaMalloc while a graph is recorded."""
    wp.set_mempool_enabled(CUDA, False)
    try:
        with wp.ScopedCapture(CUDA):
            wp.zeros(16, dtype=float, device=CUDA)
    finally:
        wp.set_mempool_enabled(CUDA, True)
    return "passed"


def _of_two_streams(*, synchronised: bool) -> str:
    a, b = arrays()
    c = wp.zeros(64, dtype=float, device=CUDA)
    wp.synchronize_device(CUDA)
    first, second = wp.Stream(CUDA), wp.Stream(CUDA)
    wp.launch(doubles, dim=64, inputs=[a, b], device=CUDA, stream=first)
    if synchronised:
        second.wait_stream(first)
    wp.launch(doubles, dim=64, inputs=[b, c], device=CUDA, stream=second)
    host = wp.zeros(64, dtype=float, device="cpu")
    wp.copy(host, c, stream=second)
    return f"{host.numpy()[0]}"


@program
def streams_without_synchronisation() -> str:
    """The second stream does not wait for what the first one writes."""
    return _of_two_streams(synchronised=False)


@program
def streams_with_synchronisation() -> str:
    """The second stream waits."""
    return _of_two_streams(synchronised=True)


def _of_two_torch_streams(*, synchronised: bool) -> str:
    x = torch.ones(8, device=CUDA)
    torch.cuda.synchronize()
    first, second = torch.cuda.Stream(), torch.cuda.Stream()
    with torch.cuda.stream(first):
        y = x * 2
        event = first.record_event()
    if synchronised:
        event.wait(second)
    with torch.cuda.stream(second):
        z = y + 1
        return f"{z[0].item()}"


@program
def torch_streams_without_synchronisation() -> str:
    """torch's second stream does not wait for the first one."""
    return _of_two_torch_streams(synchronised=False)


@program
def torch_streams_with_synchronisation() -> str:
    """torch's second stream waits for an event."""
    return _of_two_torch_streams(synchronised=True)


def _tensor_given_back_early(*, recorded: bool) -> str:
    x = torch.ones(8, device=CUDA)
    torch.cuda.synchronize()
    side = torch.cuda.Stream()
    with torch.cuda.stream(side):
        y = x + 1
    if recorded:
        x.record_stream(side)
    del x
    torch.zeros(1, device=CUDA).item()  # the memory is given back in the stream of its allocation
    side.synchronize()
    with torch.cuda.stream(side):
        return f"{y[0].item()}"


@program
def tensor_freed_while_another_stream_uses_it() -> str:
    """torch gives memory back in the stream that allocated it, whatever others do with it."""
    return _tensor_given_back_early(recorded=False)


@program
def tensor_kept_for_another_stream() -> str:
    """The other stream is recorded."""
    return _tensor_given_back_early(recorded=True)


def _pinned_copy(*, waits: bool) -> str:
    a = wp.full(8, 3.0, dtype=float, device=CUDA)
    host = wp.zeros(8, dtype=float, device="cpu", pinned=True)
    wp.synchronize_device(CUDA)
    wp.copy(host, a)
    if waits:
        wp.synchronize_stream(wp.get_stream(CUDA))
    return f"{host.numpy()[0]}"


@program
def pinned_copy_without_waiting() -> str:
    """The host reads pinned memory before the copy has arrived."""
    return _pinned_copy(waits=False)


@program
def pinned_copy_with_waiting() -> str:
    """The host waits for it."""
    return _pinned_copy(waits=True)


@program
def pageable_copy() -> str:
    """The host need not wait for a copy to ordinary memory; and what it changes later is not what a copy brings."""
    values = np.full(8, 4.0, np.float32)
    source: wp.array = wp.array(values, dtype=float, device="cpu", copy=False)
    a = wp.zeros(8, dtype=float, device=CUDA)
    wp.copy(a, source)
    values[:] = 5.0
    host = wp.zeros(8, dtype=float, device="cpu")
    wp.copy(host, a)
    return f"{host.numpy()[0]}"


@program
def array_of_the_host() -> str:
    """A kernel gets the address of an array of the host."""
    host = wp.ones(64, dtype=float, device="cpu")
    disguised: wp.array = wp.array(ptr=host.ptr, dtype=float, shape=(64,), device=CUDA)
    _, b = arrays()
    wp.launch(doubles, dim=64, inputs=[disguised, b], device=CUDA)
    wp.synchronize_device(CUDA)
    return "passed"


@program
def tensor_of_the_host() -> str:
    """torch adds tensors of two devices."""
    return f"{torch.ones(4, device=CUDA) + torch.ones(4, device='cpu')}"


@program
def replay_after_the_arguments_went() -> str:
    """A graph keeps the values of its launches."""
    a, b = arrays()
    wp.load_module(device=CUDA)
    with wp.ScopedCapture(CUDA) as capture:
        wp.launch(doubles, dim=64, inputs=[a, b], device=CUDA)
    a.fill_(5.0)
    wp.capture_launch(capture.graph)
    first = b.numpy()[0]
    a.fill_(7.0)
    wp.capture_launch(capture.graph)
    return f"{first} {b.numpy()[0]}"


def main(names: list[str]) -> None:
    """Run programs, each on a device without faults."""
    wp.config.log_level = wp.LOG_WARNING
    wp.init()
    target = device()
    target.faults.printing = False
    found = {}
    for name in names or PROGRAMS:
        target.streams.finish_all()
        target.faults.clear()
        target.faults.violations.clear()
        target.runtime.emu_clear_races()
        try:
            seen = PROGRAMS[name]()
        except (RuntimeError, TypeError) as error:
            seen = f"{type(error).__name__}: {error}"
        found[name] = {"seen": seen, "faults": [text for text, _ in target.faults.violations]}
        target.streams.captures.clear()
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1:])
