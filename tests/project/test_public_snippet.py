"""The snippet of the README and of issue 2, as it is written there, and the names it needs."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import torch

import simwarp as sw
from simwarp.core import interop

SNIPPET = """
import simwarp as sw
b = sw.ModelBuilder(gravity=(0.0, 0.0, -9.81))
cart = b.add_body("cart", mass=0.1, inertia=(1, 1, 1))
pole = b.add_body("pole", mass=0.785, inertia=(0.262, 0.262, 0.001), pose=sw.pose((0, 0, 1)))
b.add_joint_prismatic("slide", sw.WORLD, cart, axis=(1, 0, 0), limit=(-2, 2))
b.add_joint_revolute("hinge", cart, pole, anchor=(0, 0, 0), axis=(0, 1, 0))
model = b.finalize(world_count=1024, device="cpu")
sim = sw.Simulation(model, dt=0.01)
sim.control.joint_force[:, 0] = {force}
sim.step(); sim.state.body_q
sim.set_joint_state(world_mask, q, qd); sim.reset(world_mask); s = sim.snapshot(); sim.restore(s)
"""

FORCES = {
    "scalar": "2.0", "integer": "2", "numpy": "np.full(1024, 2.0)", "numpy scalar": "np.float32(2.0)",
    "list": "[2.0] * 1024", "torch": "torch.full((1024,), 2.0)", "torch float64": "torch.full((1024,), 2.0).double()",
}  # fmt: skip


@pytest.mark.parametrize("force", FORCES.values(), ids=FORCES)
def test_the_snippet_runs(force):
    mask = np.zeros(1024, bool)
    mask[7] = True
    names: dict[str, Any] = {
        "np": np,
        "torch": torch,
        "world_mask": mask,
        "q": np.full((1024, 2), 0.1, np.float32),
        "qd": None,
    }
    head, last = SNIPPET.format(force=force).rsplit("\nsim.set_joint_state", 1)
    exec(head, names)
    sim = names["sim"]
    assert sim.state.body_q.shape == (1024, 2)
    # 2 N for 10 ms on the cart: the pole leans as it is pushed. M qdd = f with the 2 x 2 mass matrix at q = 0
    matrix = np.array([[0.1 + 0.785, 0.785], [0.785, 0.785 + 0.262]])
    expected = np.linalg.solve(matrix, (2.0, 0.0)) * 0.01
    np.testing.assert_allclose(sim.state.joint_qd.numpy(), np.tile(expected, (1024, 1)), rtol=1e-4)
    before = sim.state.joint_q.numpy().copy()
    exec("sim.set_joint_state" + last, names)
    after = sim.state.joint_q.numpy()
    np.testing.assert_array_equal(after[7], (0.0, 0.0))  # set, then reset
    np.testing.assert_array_equal(np.delete(after, 7, 0), np.delete(before, 7, 0))


def cart_pole(worlds: int = 8) -> sw.Simulation:
    names: dict[str, Any] = {}
    text = SNIPPET.replace("1024", str(worlds)).split("sim.control")[0]
    exec(text, names)
    return names["sim"]


def test_torch_shares_the_memory_both_ways():
    sim, other = cart_pole(), cart_pole()
    force = interop.to_torch(sim.control.joint_force)
    assert force.data_ptr() == sim.control.joint_force.ptr
    force[:, 0] = torch.linspace(-1.0, 1.0, 8)  # torch writes: the step reads it without a copy
    other.control.joint_force[:, 0] = torch.linspace(-1.0, 1.0, 8).numpy()
    sim.step()
    other.step()
    np.testing.assert_array_equal(sim.state.body_q.numpy(), other.state.body_q.numpy())
    sim.control.joint_force[:, 0] = 3.0  # Warp writes: torch sees it
    assert force[:, 0].tolist() == [3.0] * 8
    poses = interop.to_torch(sim.state.body_q)
    before = poses.clone()
    sim.step()
    assert not torch.equal(poses, before)  # the view is the state, not a copy of it
    np.testing.assert_array_equal(poses.numpy(), sim.state.body_q.numpy())
    sim.reset(torch.arange(8) < 4)
    assert torch.equal(poses[:4, 0], torch.tensor([0.0, 0, 0, 0, 0, 0, 1]).repeat(4, 1))


def test_clearing_the_control():
    sim = cart_pole()
    view = interop.to_torch(sim.control.joint_force)
    for name in sw.Control.NAMES:
        getattr(sim.control, name).fill_(1.0)
    sim.control.clear()
    assert all(not getattr(sim.control, name).numpy().any() for name in sw.Control.NAMES)
    assert not view.any()


def test_the_cart_stops_at_its_limit():
    sim = cart_pole(2)
    sim.control.joint_force[0, 0] = 50.0
    for _ in range(200):
        sim.step()
    q = sim.state.joint_q.numpy()
    # one step at the speed it arrives with is all it may pass by
    assert q[0, 0] <= 2.0 + 1e-3
    assert abs(q[1, 0]) < 1e-3


def test_names():
    model = cart_pole(2).model
    assert (model.body("cart"), model.body("pole")) == (0, 1)
    assert (model.joint("slide"), model.dof("hinge")) == (0, 1)
    assert model.joint_dof_start == (0, 1, 2)
    assert all(hasattr(sw, name) for name in sw.__all__)


def test_the_core_does_not_import_torch():
    code = "import sys, simwarp; print(sorted({'torch', 'trimesh'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("[]")
