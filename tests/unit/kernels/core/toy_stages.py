"""Stages of three lines each, for the kernels that are made from a table of them."""

import warp as wp

from simwarp.kernels.core.scratch import ScratchGroup, memory_struct, scratch_array

# mypy: disable-error-code="index,valid-type,attr-defined"
wp.set_module_options({"enable_backward": False})


@wp.struct
class Options:
    """Numbers of a run."""

    squares: int


@wp.struct
class State:
    """What the stages read and write."""

    world_status: wp.array[int]
    value: wp.array[float]


class ToyScratch(ScratchGroup, packed=False):
    """One number."""

    number = scratch_array(wp.float32, 1)


NUMBERS = ToyScratch.struct("Numbers", __name__)
TOY_MEMORY = memory_struct("ToyMemory", __name__, (ToyScratch,))


@wp.func
def double(world: int, state: State, numbers: NUMBERS):
    numbers.number[0] = 2.0 * state.value[world]


@wp.func
def has_squares(options: Options) -> bool:
    return options.squares == 1


@wp.func
def square(world: int, numbers: NUMBERS):
    numbers.number[0] = numbers.number[0] * numbers.number[0]


@wp.func
def publish(world: int, state: State, numbers: NUMBERS):
    state.value[world] = numbers.number[0]


@wp.func_native("return view.colour;")
def colour_of(view: Options) -> float:  # type: ignore[empty-body]
    """A number of the options, asked for in C++."""


@wp.func
def other_of(numbers: NUMBERS) -> float:
    return numbers.other[0]


@wp.func
def publish_sum(world: int, state: State, options: Options, numbers: NUMBERS):
    state.value[world] = numbers.number[0] + other_of(numbers) + colour_of(options)


@wp.func
def lost(world: int, colour: int):
    pass


class Toy:
    """The functions of the stages."""

    double, has_squares, square, lost = double, has_squares, square, lost
    publish, publish_sum = publish, publish_sum
