"""Bytes that a world takes, and those that all share."""

import warp as wp

from simwarp.bench.measure import bytes_of

ROW = 32
"""Words to which a GPU pads a row of a slot as soon as there is a second world."""


def test_a_world_takes_what_the_third_one_adds_where_the_second_pads_rows():
    def arrays(count: int) -> list[wp.array]:
        padded = wp.zeros((count, 3, 1 if count == 1 else ROW), dtype=float, device="cpu")
        return [padded, wp.zeros(10, dtype=float, device="cpu")]

    assert bytes_of(arrays) == (4 * 3 * ROW, 4 * 10)
