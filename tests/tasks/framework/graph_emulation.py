"""CUDA graphs on a CPU: what torch and Warp launch is written down once, and launched again on the same memory.

Python between the launches runs once, as it does where a stream is captured.
"""

import contextlib
from collections.abc import Callable

import torch
import warp as wp
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from simwarp.simulation.world_launches import WorldProgram

WARP = ("launch", "copy")
ARRAYS = ("fill_", "zero_", "assign")


class Emulator:
    """Makes graphs: `recorded` and `replayed` count them and their replays."""

    def __init__(self):
        self.recorded = 0
        self.replayed = 0

    def record(self, body):
        """As `simwarp.tasks.framework.capture.Recorder`. The body runs at once: this is the first replay."""
        self.recorded += 1
        calls: list[Callable[[], None]] = []
        with _warp_written_down(calls), _Tape(calls):
            outcome = body()
        done = [True]

        def replay():
            self.replayed += 1
            if done:
                done.clear()
                return
            with torch.no_grad():
                for call in calls:
                    call()

        return replay, outcome


class _Tape(TorchDispatchMode):
    """Writes down operations of torch; views look at the same memory and are not repeated."""

    def __init__(self, calls):
        super().__init__()
        self._calls = calls

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        kwargs = kwargs or {}
        result = func(*args, **kwargs)
        mutable = func._schema.is_mutable
        view = any(argument.alias_info is not None for argument in func._schema.arguments) and not mutable
        if not view and "empty" not in func.name():
            outputs = [leaf for leaf in tree_leaves(result) if isinstance(leaf, torch.Tensor)]

            def again():
                made = [leaf for leaf in tree_leaves(func(*args, **kwargs)) if isinstance(leaf, torch.Tensor)]
                for output, value in zip(outputs, made, strict=True):
                    if output.data_ptr() != value.data_ptr():
                        output.copy_(value)

            self._calls.append(again)
        return result


@contextlib.contextmanager
def _warp_written_down(calls):
    """Write down launches of Warp with the arguments that they have now."""
    within: list[int] = []

    def written(owner, name, repeat):
        function = getattr(owner, name)

        def call(*arguments, **options):
            if not within and not options.get("record_cmd"):
                calls.append(repeat(function, arguments, options))
            within.append(1)
            try:
                return function(*arguments, **options)
            finally:
                within.pop()

        setattr(owner, name, call)
        return owner, name, function

    def plainly(function, arguments, options):
        return lambda: function(*arguments, **options)

    def with_parameters(function, arguments, options):
        launch = arguments[0]
        kept = list(launch.params)

        def again():
            now, launch.params = launch.params, kept
            function(launch)
            launch.params = now

        return again

    patched = [written(wp, name, plainly) for name in WARP]
    patched += [written(wp.array, name, plainly) for name in ARRAYS]
    patched.append(written(wp.Launch, "launch", with_parameters))
    patched.append(written(WorldProgram, "run", plainly))  # on a CPU a graph of its own
    try:
        yield
    finally:
        for owner, name, function in patched:
            setattr(owner, name, function)
