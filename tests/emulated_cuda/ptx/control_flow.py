"""What counting needs to know of a PTX module: its blocks of instructions, and where lanes that parted meet again."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from typing import Final

CLASSES: Final = (
    "fp32", "fp64", "integer", "special", "move", "control", "convert", "global_load", "global_store", "local",
    "shared", "param",
)  # fmt: skip
"""Classes of instructions that are counted."""
SPECIAL: Final = frozenset(("rcp", "sqrt", "rsqrt", "sin", "cos", "ex2", "lg2", "tanh", "div"))
LATENCY: Final = {"special": 18, "fp64": 8, "convert": 8, "local": 35, "shared": 25, "param": 0, "move": 0}
"""Cycles until the result of an instruction can be used; 4 of the others. Of global loads, see `Block.rounds`."""
USUAL_LATENCY: Final = 4
RETURN: Final = -1
"""Stands for the end of a function."""
NO_CALL: Final = -2


def instruction_class(name: str, modifiers: Sequence[str]) -> str:
    """Class of an instruction, one of `CLASSES`."""
    if name in ("ld", "ldu", "st", "atom", "red"):
        space = next((each for each in modifiers if each in ("local", "param", "const", "shared")), "global")
        if space == "global":
            return "global_load" if name in ("ld", "ldu") else "global_store"
        return "param" if space == "const" else space
    if name in SPECIAL:
        return "special"
    if name in ("mov", "cvta", "selp"):
        return "move"
    if name in ("bra", "ret", "exit", "call"):
        return "control"
    if name == "cvt":
        return "convert"
    return "fp64" if "f64" in modifiers else "fp32" if "f32" in modifiers else "integer"


@dataclasses.dataclass
class Block:
    """Instructions in a row without a branch among them.

    Attributes:
        function: index of its function.
        counts: instructions by class.
        targets: labels that its branch leads to; None for the end of the function.
        falls: whether the next block may follow.
        calls: whether it ends with a call, after which the next block follows.
        rounds: loads from global memory one after the other: each needs the result of the one before.
        cycles: from the first instruction to the last result, loads from global memory apart.
    """

    function: int
    counts: dict[str, int] = dataclasses.field(default_factory=lambda: dict.fromkeys(CLASSES, 0))
    targets: list[str | None] = dataclasses.field(default_factory=list)
    falls: bool = True
    calls: bool = False
    rounds: int = 0
    cycles: int = 0
    _ready: dict[str, tuple[int, int]] = dataclasses.field(default_factory=dict)

    def add(self, name: str, modifiers: Sequence[str], operands: Sequence[str], guard: str) -> None:
        """Count an instruction, and follow what it waits for."""
        kind = instruction_class(name, modifiers)
        self.counts[kind] += 1
        registers = [re.findall(r"%[\w$]+", each) for each in operands]
        writes = bool(registers) and name not in ("st", "red", "bra", "ret", "exit", "call", "bar", "barrier")
        used = [each for group in registers[int(writes) :] for each in group] + ([guard] if guard else [])
        rounds = max((self._ready[each][0] for each in used if each in self._ready), default=0)
        cycles = max((self._ready[each][1] for each in used if each in self._ready), default=0)
        rounds += kind == "global_load" or name == "atom"
        cycles += 0 if kind == "global_load" else LATENCY.get(kind, USUAL_LATENCY)
        if writes:
            self._ready.update(dict.fromkeys(registers[0], (rounds, cycles)))
        self.rounds, self.cycles = max(self.rounds, rounds), max(self.cycles, cycles)


class ControlFlow:
    """Blocks of a module, in the order of its text.

    Attributes:
        blocks: of all functions.
    """

    def __init__(self) -> None:
        self.blocks: list[Block] = []
        self._labels: list[dict[str, int]] = []

    def begin_function(self) -> int:
        """Start a function; index of its first block."""
        self._labels.append({})
        return self.begin_block()

    def begin_block(self, label: str = "") -> int:
        """Start a block, at a label if it has one; its index."""
        if label:
            self._labels[-1][label] = len(self.blocks)
        self.blocks.append(Block(len(self._labels) - 1))
        return len(self.blocks) - 1

    def add(self, name: str, modifiers: Sequence[str], operands: Sequence[str], guard: str) -> bool:
        """Count an instruction of the present block; whether the block ends with it."""
        block = self.blocks[-1]
        block.add(name, modifiers, operands, guard)
        if name in ("bra", "ret", "exit"):
            block.targets.append(operands[0] if name == "bra" else None)
            block.falls = bool(guard)
            return True
        block.calls = name == "call" and not any("vprintf" in each or "__assertfail" in each for each in operands)
        return block.calls

    def facts(self) -> dict[str, list[list[int]] | list[int]]:
        """What a count needs, as lists that JSON holds.

        `meeting`: per block, the one at which lanes that part after it meet again, or `RETURN`. `after_call`: the block
        after its call, or `NO_CALL`. `weights`: instructions by class, then rounds and cycles.
        """
        members: dict[int, list[int]] = {}
        for index, block in enumerate(self.blocks):
            members.setdefault(block.function, []).append(index)
        meeting = [RETURN] * len(self.blocks)
        for function, blocks in members.items():
            for index, place in self._meetings(function, blocks).items():
                meeting[index] = place
        return {
            "meeting": meeting,
            "after_call": [index + 1 if block.calls else NO_CALL for index, block in enumerate(self.blocks)],
            "weights": [[*block.counts.values(), block.rounds, block.cycles] for block in self.blocks],
        }

    def _meetings(self, function: int, blocks: Sequence[int]) -> dict[int, int]:
        """Immediate postdominators of a function's blocks (Cooper, Harvey and Kennedy 2001, on the reversed graph)."""
        end = blocks[-1] + 1
        follow: dict[int, list[int]] = {}
        before: dict[int, list[int]] = {}
        for index in blocks:
            block = self.blocks[index]
            follow[index] = [end if each is None else self._labels[function].get(each, end) for each in block.targets]
            if block.falls:
                follow[index].append(index + 1)  # the last one's is the end
            for each in follow[index]:
                before.setdefault(each, []).append(index)
        order = _postorder(end, before)
        number = {each: place for place, each in enumerate(order)}
        meeting = {end: end}
        changed = True
        while changed:
            changed = False
            for index in reversed(order[:-1]):
                found = [each for each in follow[index] if each in meeting]
                place = found[0]
                for other in found[1:]:
                    place = _common(place, other, meeting, number)
                if meeting.get(index) != place:
                    meeting[index] = place
                    changed = True
        return {index: RETURN if meeting.get(index, end) == end else meeting[index] for index in blocks}


def _postorder(root: int, children: dict[int, list[int]]) -> list[int]:
    """Nodes that can be reached from a root, each after its children; the root is last."""
    order, seen, stack = [], {root}, [(root, iter(children.get(root, [])))]
    while stack:
        node, rest = stack[-1]
        child = next((each for each in rest if each not in seen), None)
        if child is None:
            order.append(node)
            stack.pop()
        else:
            seen.add(child)
            stack.append((child, iter(children.get(child, []))))
    return order


def _common(one: int, other: int, above: dict[int, int], number: dict[int, int]) -> int:
    """The nearest node above both."""
    while one != other:
        while number[one] < number[other]:
            one = above[one]
        while number[other] < number[one]:
            other = above[other]
    return one
