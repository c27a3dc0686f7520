"""Several models in one batch, a group of worlds for each: what differs between them, and who has which worlds."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from typing import Any

from simwarp.core.types import formatted

from .errors import InputError


@dataclasses.dataclass(frozen=True)
class Mix:
    """What differs between the models of a batch.

    Attributes:
        field: of the task's configuration; ``"rewards.goal"`` reaches into a nested one.
        words: its values as they are written, one for each model, which is called by it.
    """

    field: str
    words: tuple[str, ...]

    def value(self, word: str, like: Any) -> Any:
        """Return the value that a word stands for.

        Args:
            word: one of `words`.
            like: the field's present value: where it is text, a word is a text too.
        """
        if isinstance(like, str):
            return word
        try:
            return json.loads(word)
        except ValueError:
            return word


def parse_mix(text: str) -> Mix | None:
    """Return the mix that ``FIELD=a,b,c`` says; None of an empty text.

    Raises:
        InputError: it is no such text, or has fewer than two values or one of them twice.
    """
    if not text:
        return None
    field, equals, values = text.partition("=")
    words = tuple(word.strip() for word in values.split(","))
    name = field.strip().replace("-", "_")
    named = all(part.isidentifier() for part in name.split("."))
    if not (equals and named and all(words) and len(set(words)) == len(words) > 1):
        raise InputError(
            f"mix must be a field and at least two different values, such as vehicle=hmmwv,gator, got {formatted(text)}"
        )
    return Mix(name, words)


def worlds_of_models(models: Sequence[str], shares: Sequence[float], num_worlds: int, task: str) -> list[int]:
    """Return how many worlds each model has: whole numbers nearest to the shares, at least one.

    Args:
        models: their names.
        shares: of the worlds, dimensionless, one for each model; empty: equal ones.
        num_worlds: number of all worlds W.
        task: its name, for errors.

    Raises:
        InputError: there are more models than worlds, or another number of shares than of models.
    """
    count = len(models)
    if len(shares) not in (0, count):
        raise InputError(f"mix-shares must be {count} numbers, one for each of {', '.join(models)}, got {list(shares)}")
    if num_worlds < count:
        raise InputError(
            f"task '{task}': {count} models ({', '.join(models)}) need a world each, got {num_worlds}; take at least "
            f"{count} worlds"
        )
    parts = [1.0] * count if not shares else [float(share) for share in shares]
    spare = num_worlds - count  # each has one already
    wanted = [num_worlds * part / math.fsum(parts) for part in parts]
    over = [max(each - 1.0, 0.0) for each in wanted]
    exact = [spare * each / math.fsum(over) for each in over] if spare else [0.0] * count
    counts = [1 + math.floor(each) for each in exact]
    by_rest = sorted(range(count), key=lambda index: math.floor(exact[index]) - exact[index])
    for index in by_rest[: num_worlds - sum(counts)]:
        counts[index] += 1
    return counts
