"""Threads of a GPU that share one problem: lanes of a warp, which divide its rows and add up what they find.

Device functions take `lanes`, how many share the problem: 2, 4, 8, 16 or 32 neighbours in a warp; 0 or 1 is a thread by
itself, as every one of a CPU is. A native text begins with `VIEWS + LANES` and then uses, for all of these:

    ROLLED for (int i = lane; i < n; i += stride) ...  // the lane's share of a loop, which is short: not unrolled
    total = sum_of_lanes(total);                // of all lanes, which all get it, the same bits
    worst = greatest_of_lanes(worst);
    meet_lanes();                               // what lanes have written before, all may read after

Each function of `cones` ends with `meet_lanes()`, so that the next may read what it wrote and write what it read.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


def lanes_for(rows: int) -> int:
    """How many lanes of a warp share the cone problem of a world, which has at most so many rows.

    One thread would keep a step waiting: the few worlds with most iterations need some ten times those of the mean.
    """
    return next((lanes for lanes, most in ((1, 8), (8, 32), (16, 128)) if rows <= most), 32)


LANES = """
#ifdef __CUDA_ARCH__
#define ROLLED _Pragma("unroll 1")
    const int stride = lanes > 1 ? lanes : 1, lane = lanes > 1 ? (int)threadIdx.x & (lanes - 1) : 0;
    const unsigned members = stride < 32 ? ((1u << stride) - 1) << ((threadIdx.x & 31) - lane) : ~0u;
    auto meet_lanes = [=]() {
        if (lanes > 1) __syncwarp(members);
    };
    auto sum_of_lanes = [=](auto value) {
        for (int apart = stride / 2; apart > 0; apart /= 2) value += __shfl_xor_sync(members, value, apart);
        return value;
    };
    auto greatest_of_lanes = [=](auto value) {
        for (int apart = stride / 2; apart > 0; apart /= 2) {
            const auto other = __shfl_xor_sync(members, value, apart);
            value = other > value ? other : value;
        }
        return value;
    };
#else
#define ROLLED
    constexpr int stride = 1, lane = 0;
    auto meet_lanes = []() {};
    auto sum_of_lanes = [](auto value) { return value; };
    auto greatest_of_lanes = [](auto value) { return value; };
#endif
"""


@wp.func_native(LANES + "return lane;")
def lane_of(lanes: int) -> int:
    """The place of this thread among those that share a problem."""
    ...


@wp.func_native(LANES + "return stride;")
def stride_of(lanes: int) -> int:
    """How many threads share a problem: what one of them passes over in a loop."""
    ...


@wp.func_native(LANES + "meet_lanes();")
def meet(lanes: int):
    """What the lanes of a problem have written before, all of them may read after."""
    ...


@wp.func_native(LANES + "return sum_of_lanes(value);")
def sum_over_lanes(lanes: int, value: float) -> float:
    """The sum over the lanes of a problem, the same bits for all of them."""
    ...


@wp.func_native(LANES + "return greatest_of_lanes(value);")
def greatest_over_lanes(lanes: int, value: float) -> float:
    """The greatest over the lanes of a problem."""
    ...
