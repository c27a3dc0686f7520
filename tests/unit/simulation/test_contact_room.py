"""With few contact slots the deepest contacts are kept, however many pairs of shapes come near each other."""

import numpy as np
import pytest

import simwarp as sw


def gaps(capacity: int | None, shape: str) -> tuple[np.ndarray, int]:
    """Gaps of sixteen bodies in one place, sorted, and how many contacts found no slot."""
    builder = sw.ModelBuilder()
    rng = np.random.default_rng(4)
    for index in range(16):
        body = builder.add_body(
            f"b{index}", mass=1.0, inertia=(0.01, 0.01, 0.01), pose=sw.pose(rng.uniform(-0.15, 0.15, 3))
        )
        if shape == "box":
            builder.add_shape_box(body, half=(0.2, 0.2, 0.2))
        else:
            builder.add_shape_sphere(body, radius=0.2)
    sim = sw.Simulation(builder.finalize(1, "cpu", contact_capacity=capacity), 1e-3, check_start=False, threads=1)
    sim.step()
    count = int(sim.contacts.contact_count.numpy()[0])
    return np.sort(sim.contacts.contact_gap.numpy()[0, :count]), int(sim.contacts.contact_overflow.numpy()[0])


@pytest.mark.parametrize("shape", ["box", "sphere"])
def test_the_deepest_contacts_are_kept(shape):
    every, overflow = gaps(1000, shape)
    assert overflow == 0
    assert len(every) >= 100  # of 120 pairs: more than any list had room for at this capacity
    few, lost = gaps(8, shape)
    np.testing.assert_array_equal(few, every[:8])
    assert lost == len(every) - 8
