"""Random numbers of a study: every world has its own, whatever worlds run beside it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
import torch

from simwarp.study.varied_vehicle import VariedVehicle
from simwarp.tasks.randomisation.randomness import WorldRandom

HALF: Final = 2.0**-25
"""Half of the distance between draws, so that none is 0."""


def drawn_shares(keys: Sequence[str], seed: int, first: int, count: int) -> npt.NDArray[np.float64]:
    """(count, K) uniform draws between 0 and 1, none at an end.

    The draw of a world is a function of the seed, the key's name and the world's index alone.

    Args:
        keys: names.
        seed: any integer.
        first: index of the first world.
        count: of worlds.
    """
    none = torch.zeros(count, dtype=torch.int64)
    random = WorldRandom(seed, none, none.clone(), first_world=first)
    columns = [random.uniform(f"vary {key}").numpy()[:, 0].astype(float) + HALF for key in keys]
    return np.stack(columns, axis=1)


def drawn_worlds(vehicle: VariedVehicle, seed: int, first: int, count: int) -> list[tuple[float, ...]]:
    """Values of the keys in some worlds."""
    shares = drawn_shares([key.name for key in vehicle.keys], seed, first, count)
    return [vehicle.drawn(row) for row in shares.tolist()]
