"""The kernel that makes other launches of a CPU: native code calls them as Warp would."""

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.func_native("""
    typedef void (*Code)(void* bounds, void* arguments);
    const uint64_t* call = calls.data;
    for (int turn = 0; turn < times; ++turn)
        for (int i = 0; i < calls.shape[0]; ++i)
            ((Code)call[3 * i])((void*)call[3 * i + 1], (void*)call[3 * i + 2]);
""")
def make_calls(calls: wp.array2d[wp.uint64], times: int) -> None:
    """Makes all calls in turn, `times` over."""
    ...


@wp.kernel
def launch_in_turn(calls: wp.array2d[wp.uint64], times: int) -> None:
    """Makes launches in turn, `times` over; `calls` is (launches, 3): addresses of code, bounds and arguments."""
    make_calls(calls, times)
