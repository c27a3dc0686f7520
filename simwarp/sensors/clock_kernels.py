"""The clock of a sensor: which worlds collect, complete and publish a frame in this sub-step.

Every world counts its sub-steps since its reset. Frame k begins at s = phase + k period, collects over the sub-steps
(s, s + window] (window 0: the one instant s), is complete at s + window and published `lag` later. A frame that no
reader can see is not taken: readers look when the count is a multiple of `every`, and see the latest one published.
"""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.core.world_status import NON_FINITE
from simwarp.sensors.random_kernels import frame_key

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

PHASE_PURPOSE = wp.constant(0x70686173)

IDLE = wp.constant(0)
"""`SampleEvents.mode`: nothing happens in this world; leave its memory alone."""
STEP = wp.constant(1)
"""`SampleEvents.mode`: a sub-step has passed."""
BEGIN = wp.constant(2)
"""`SampleEvents.mode`: the world's state was set; forget, and take one frame of it as if it had always stood so."""


@wp.struct
class ClockSettings:
    """Numbers of a clock, in sub-steps."""

    period: int
    window: int
    lag: int
    every: int  # between two reads
    slots: int  # of the ring of frames in waiting
    random_phase: int  # 1: an integer in [0, period) per world and episode
    stream: wp.uint64  # randomness of the sensor


@wp.struct
class ClockState:
    """State of a clock, per world."""

    count: wp.array[int]  # sub-steps since the world's state was set, those in which it was frozen included
    episode: wp.array[int]  # number of times that it was set
    phase: wp.array[int]
    ring_time: wp.array[wp.float64]  # (W·slots,) world time at completion [s]
    timestamp: wp.array[wp.float64]  # of the published frame [s]
    valid: wp.array[wp.bool]


@wp.struct
class SampleEvents:
    """Actions of a sensor in this sub-step, per world; written by the clock, read by the kernels of its sensor."""

    mode: wp.array[int]  # IDLE, STEP or BEGIN
    collecting: wp.array[int]  # 1: this sub-step lies in the window of a frame that somebody will see
    fraction_from: wp.array[float]  # the part of the window that it covers: [from, to)
    fraction_to: wp.array[float]
    first: wp.array[int]  # 1: a frame begins: clear what it adds up
    complete: wp.array[int]  # 1: a frame is done: write it into row `row` of the ring
    row: wp.array[int]  # of the frame that is being collected
    frame: wp.array[int]  # its number since the state was set, for randomness; 0: the one taken by BEGIN
    key: wp.array[wp.uint64]  # its random key (random_kernels.py)
    publish: wp.array[int]  # 1: row `publish_row` of the ring becomes the data
    publish_row: wp.array[int]


@wp.func
def will_be_read(published: int, clock: ClockSettings) -> bool:
    """True if data are read between the publication of a frame, at this count, and that of the next."""
    look = ((published + clock.every - 1) / clock.every) * clock.every
    return look < published + clock.period


@wp.func
def clear_events(world: int, mode: int, tick: SampleEvents):
    """A tick without a frame."""
    tick.mode[world] = mode
    tick.collecting[world] = 0
    tick.fraction_from[world] = 0.0
    tick.fraction_to[world] = 0.0
    tick.first[world] = 0
    tick.complete[world] = 0
    tick.publish[world] = 0


@wp.kernel
def advance_clock(
    # inputs
    worlds: WorldRange,
    clock: ClockSettings,
    steps: int,
    state: StateArrays,
    # outputs
    memory: ClockState,
    tick: SampleEvents,
):
    """After a sub-step, the last of `steps`: nothing was due in those before it."""
    world = worlds.first + wp.tid()
    # in frozen worlds too: when they froze within `steps` is not known, and clocks that begin together stay so
    count = memory.count[world] + steps
    memory.count[world] = count
    if (state.world_status[world] & NON_FINITE) != 0:
        clear_events(world, IDLE, tick)
        memory.valid[world] = False
        return
    clear_events(world, STEP, tick)
    begin = memory.phase[world]
    # the sub-step (count - 1, count] in its period; with no window a frame begins and ends at its end
    shift = wp.where(clock.window > 0, 1, 0)
    elapsed = count - shift - begin
    if elapsed >= 0:
        frame = elapsed / clock.period
        part = elapsed - frame * clock.period
        published = begin + frame * clock.period + clock.window + clock.lag
        if part < wp.max(clock.window, 1) and will_be_read(published, clock):
            tick.collecting[world] = 1
            window = float(wp.max(clock.window, 1))
            tick.fraction_from[world] = float(part) / window
            tick.fraction_to[world] = float(part + 1) / window
            tick.first[world] = wp.where(part == 0, 1, 0)
            row = world * clock.slots + frame % clock.slots
            tick.row[world] = row
            tick.frame[world] = frame + 1
            tick.key[world] = frame_key(clock.stream, world, memory.episode[world], frame + 1)
            if part + 1 >= clock.window:
                tick.complete[world] = 1
                memory.ring_time[row] = state.world_time[world]
    completed = count - clock.lag
    elapsed = completed - clock.window - begin
    # at count 0 it was BEGIN that took a frame
    if completed >= 1 and elapsed >= 0 and elapsed % clock.period == 0 and will_be_read(count, clock):
        row = world * clock.slots + (elapsed / clock.period) % clock.slots
        tick.publish[world] = 1
        tick.publish_row[world] = row
        memory.timestamp[world] = memory.ring_time[row]


@wp.kernel
def begin_clock(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    clock: ClockSettings,
    state: StateArrays,
    # outputs
    memory: ClockState,
    tick: SampleEvents,
):
    """Restarts clocks of worlds whose state was set: pending frames are dropped, one of the new state is published."""
    world = worlds.first + wp.tid()
    if not mask[world]:
        clear_events(world, IDLE, tick)
        return
    episode = memory.episode[world] + 1
    memory.episode[world] = episode
    memory.count[world] = 0
    if clock.random_phase == 1:
        bits = frame_key(clock.stream, world, episode, PHASE_PURPOSE) >> wp.uint64(32)
        memory.phase[world] = int((bits * wp.uint64(clock.period)) >> wp.uint64(32))
    row = world * clock.slots
    memory.ring_time[row] = state.world_time[world]
    memory.timestamp[world] = state.world_time[world]
    memory.valid[world] = True
    tick.mode[world] = BEGIN
    tick.collecting[world] = 1
    tick.fraction_from[world] = 0.0
    tick.fraction_to[world] = 1.0
    tick.first[world] = 1
    tick.complete[world] = 1
    tick.row[world] = row
    tick.frame[world] = 0
    tick.key[world] = frame_key(clock.stream, world, episode, 0)
    tick.publish[world] = 1
    tick.publish_row[world] = row


@wp.kernel
def publish_words(
    # inputs
    worlds: WorldRange,
    threads: int,
    tick: SampleEvents,
    ring: wp.array2d[int],  # (W·slots, words)
    # outputs
    data: wp.array2d[int],  # (W, words)
):
    """Rows of the ring that are due become the data; `threads` threads share a row."""
    index, thread = wp.tid()
    world = worlds.first + index
    if tick.publish[world] == 1:
        row = tick.publish_row[world]
        for word in range(thread, data.shape[1], threads):
            data[world, word] = ring[row, word]


@wp.kernel
def publish_bytes(
    # inputs
    worlds: WorldRange,
    threads: int,
    tick: SampleEvents,
    ring: wp.array2d[wp.uint8],  # (W·slots, bytes)
    # outputs
    data: wp.array2d[wp.uint8],  # (W, bytes)
):
    """The same for rows that are no whole number of words."""
    index, thread = wp.tid()
    world = worlds.first + index
    if tick.publish[world] == 1:
        row = tick.publish_row[world]
        for byte in range(thread, data.shape[1], threads):
            data[world, byte] = ring[row, byte]
