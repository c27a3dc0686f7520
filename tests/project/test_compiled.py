"""What test workers compile beforehand is what launches on a CPU take."""

import warp as wp

from simwarp import ModelBuilder, Simulation
from simwarp.kernels.dynamics.step_stages import fused_tree_step
from tests.compiled import CPU_BLOCK


def test_the_step_is_launched_in_blocks_of_that_size():
    """A unit of another size would be compiled once more, for half a minute."""
    builder = ModelBuilder()
    builder.add_body("ball", mass=1.0, inertia=(1.0, 1.0, 1.0))
    Simulation(builder.finalize(1, device="cpu"), dt=1e-3).step()
    context = wp.get_device("cpu").context
    blocks = {block for where, block in fused_tree_step().kernel.module.execs if where == context}
    assert blocks == {CPU_BLOCK}
