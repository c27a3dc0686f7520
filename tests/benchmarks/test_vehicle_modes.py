"""Modes of a full vehicle in closed loops, on tires."""

import numpy as np
import pytest

from benchmarks.vehicle_modes import standing_modes


@pytest.mark.slow
def test_a_hmmwv_heaves_rolls_and_pitches_before_its_wheels_hop() -> None:
    """The chassis takes part in the slow modes alone, and each of the three has its own direction."""
    found = standing_modes("hmmwv")
    assert len(found.linearisation.coordinates) == 15
    swinging = [index for index, frequency in enumerate(found.frequency) if 1.8 < frequency < 12.0]
    chassis = np.abs([found.bodies(index)[0] for index in swinging])
    assert list(chassis[:3, 2:5].argmax(axis=1)) == [0, 1, 2]  # heave, roll, pitch
    assert chassis[:3].max(axis=1).min() > 5.0 * chassis[3:].max()
