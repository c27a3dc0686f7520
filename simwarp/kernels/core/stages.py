"""Stages of one world's work, and the kernels that are made from a table of them.

A stage is a device function of one world. A CPU runs all stages of a table in one kernel, which goes from world to
world, so that intermediate values stay in the cache. A GPU runs a kernel for each: one with everything inlined would
take minutes to compile, spill its registers and overflow the instruction cache. Both are written from the table.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import linecache
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import warp as wp

from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of
from simwarp.kernels.core.world_status import NON_FINITE


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stage:
    """One stage of a table.

    Attributes:
        name: of the stage, and of its own kernel.
        function: device function of one world. The names of its parameters say what it gets: `world`, `scratch_slot`,
            its place in scratch memory, a name of `StageRoom.locals`, or an argument of the kernel.
        reads, writes: what it needs and what it leaves to those that follow.
        when: device function of some arguments of the kernel, which tells on the host as well whether the model has
            this stage; None: every model has it.
        lanes: threads of a GPU that share a world (lanes.py).
    """

    name: str
    function: Any
    reads: str
    writes: str
    when: Any = None
    lanes: int = 1

    def is_due(self, arguments: Mapping[str, Any]) -> bool:
        """Whether a model with these arguments has the stage."""
        return self.when is None or bool(self.when.func(*(arguments[name] for name in parameters_of(self.when))))


@dataclasses.dataclass(frozen=True)
class StageLocal:
    """A value that a kernel finds once, by a device function of an argument and a slot of that.

    Attributes:
        function: the device function.
        argument: its name.
        part: makes a function of a name that finds only the attributes of some names, inlined as `inline=` says
            (`wp.func`); None: the whole is found.
    """

    function: Any
    argument: str
    part: Callable[..., Any] | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class StageRoom:
    """Arguments that functions of stages may have by name, beside `world` and `scratch_slot`.

    Attributes:
        module: that their kernels belong to.
        options: of that module.
        arguments: of the kernels, by name, with their types, in their order.
        locals: found once in a kernel, by name.
    """

    module: str
    options: Mapping[str, Any]
    arguments: Mapping[str, Any]
    locals: Mapping[str, StageLocal]


@dataclasses.dataclass(frozen=True)
class StageKernel:
    """A kernel, the names of its arguments after the `WorldRange`, and how many threads a world has."""

    kernel: wp.Kernel
    arguments: tuple[str, ...]
    lanes: int = 1


def parameters_of(function: Any) -> tuple[str, ...]:
    """Names of a device function's parameters."""
    return tuple(inspect.signature(function.func).parameters)


def attributes_of(function: Any) -> frozenset[str]:
    """Names of all attributes that a device function asks for, of whatever, and those that it calls."""
    found: set[str] = set()
    pending, seen = [function], set()
    while pending:
        each = pending.pop()
        if each in seen or each.is_builtin():
            continue
        seen.add(each)
        found |= set(re.findall(r"\.(\w+)", each.native_snippet or ""))
        body = ast.Module(each.adj.tree.body[0].body, [])
        found |= {node.attr for node in ast.walk(body) if isinstance(node, ast.Attribute)}
        used = inspect.getclosurevars(each.func)
        values = [*used.globals.values(), *used.nonlocals.values()]
        pending += [value for value in values if isinstance(value, wp.Function)]
    return frozenset(found)


def _arguments_of(functions: Iterable[Any], room: StageRoom) -> tuple[str, ...]:
    """What a kernel of these functions takes, in the room's order."""
    asked = {name for function in functions for name in parameters_of(function)}
    names = {room.locals[name].argument if name in room.locals else name for name in asked}
    names = (names - {"world", "scratch_slot"}) | {"state"}
    unknown = names - set(room.arguments)
    if unknown:
        raise ValueError(f"{room.module}: stages ask for {', '.join(sorted(unknown))}, which their kernels do not have")
    return tuple(name for name in room.arguments if name in names)


def _call(function: str, of: Any) -> str:
    return f"{function}({', '.join(parameters_of(of))})"


def _make(name: str, body: Sequence[str], arguments: tuple[str, ...], names: dict[str, Any], room: StageRoom) -> Any:
    """Return the kernel of a text. Warp compiles kernels from their source."""
    head = ", ".join(["worlds: WorldRange", *(f"{each}: type_of_{each}" for each in arguments)])
    source = "\n".join([f"def {name}({head}):", *(f"    {line}" for line in body), ""])
    file = f"<{room.module}.{name}>"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    scope = {
        "WorldRange": WorldRange, "NON_FINITE": NON_FINITE, "scratch_slot_of": scratch_slot_of, "wp": wp,
        "__name__": room.module, **{f"type_of_{each}": room.arguments[each] for each in arguments}, **names,
    }  # fmt: skip
    exec(compile(source, file, "exec"), scope)
    return wp.kernel(enable_backward=False, module="unique", module_options=dict(room.options))(scope[name])


def _local_lines(functions: Iterable[Any], slot: str, room: StageRoom) -> list[str]:
    asked = {name for function in functions for name in parameters_of(function)}
    lines = [f"scratch_slot = {slot}"]
    return lines + [
        f"{name} = make_{name}({each.argument}, scratch_slot)" for name, each in room.locals.items() if name in asked
    ]


def _scope(stages: Sequence[Stage], room: StageRoom) -> dict[str, Any]:
    names = {f"make_{name}": each.function for name, each in room.locals.items()}
    for stage in stages:
        names[f"stage_{stage.name}"] = stage.function
        if stage.when is not None:
            names[stage.when.key] = stage.when
    return names


def _with_parts(
    kernel: str, functions: Sequence[Any], room: StageRoom, *, inline: bool | None = None
) -> StageRoom:  # fmt: skip
    """The room with locals of which only what these functions ask for is found."""
    asked = frozenset[str]().union(*map(attributes_of, functions))
    parts = {
        name: dataclasses.replace(each, function=each.part(f"{name}_for_{kernel}", asked, inline=inline))
        for name, each in room.locals.items()
        if each.part is not None and any(name in parameters_of(function) for function in functions)
    }
    return dataclasses.replace(room, locals={**room.locals, **parts})


def fused_kernel(name: str, stages: Sequence[Stage], room: StageRoom) -> StageKernel:
    """Make the kernel that takes one world after the other through all stages."""
    functions = [each for stage in stages for each in (stage.function, stage.when) if each is not None]
    room = _with_parts(name, functions, room, inline=False)
    arguments = _arguments_of(functions, room)
    body = [*_local_lines(functions, "worlds.slot", room), "for k in range(worlds.count):",
            "    world = worlds.first + k", "    if (state.world_status[world] & NON_FINITE) != 0:",
            "        continue"]  # fmt: skip
    last = None
    for stage in stages:
        indent = "    "
        if stage.when is not None:
            if stage.when is not last:
                body.append(f"    if {_call(stage.when.key, stage.when)}:")
            indent = "        "
        last = stage.when
        body.append(indent + _call(f"stage_{stage.name}", stage.function))
    return StageKernel(_make(name, body, arguments, _scope(stages, room), room), arguments)


def separate_kernel(stage: Stage, room: StageRoom) -> StageKernel:
    """Make the kernel of one stage, with a thread for each world, or a row of lanes.

    It finds only the attributes of locals that the stage asks for: compilers spend most of their time on the others.
    """
    room = _with_parts(stage.name, [stage.function], room)
    arguments = _arguments_of([stage.function], room)
    body = [
        "k = wp.tid()" if stage.lanes == 1 else "k, lane = wp.tid()", "world = worlds.first + k",
        "if (state.world_status[world] & NON_FINITE) != 0:", "    return",
        *_local_lines([stage.function], "scratch_slot_of(world, worlds)", room),
        _call(f"stage_{stage.name}", stage.function),
    ]  # fmt: skip
    return StageKernel(_make(stage.name, body, arguments, _scope([stage], room), room), arguments, stage.lanes)
