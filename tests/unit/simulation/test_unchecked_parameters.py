"""Parameters that a kernel or a copy fills with NaN in the middle of a run: the other worlds go on, and problems() says
which parameter of which world it is, also where no rate shows it.
"""

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.model.parameters import PARAMETERS

WORLDS, BAD = 3, 1


def puck_and_pendulum(name):
    """A ball at rest on the ground, and a hinge with every law; one parameter of its own in each world."""
    builder = sw.ModelBuilder()
    puck = builder.add_body("puck", mass=1.0, inertia=(1, 1, 1), pose=sw.pose((0, 0, 0.1)))
    bob = builder.add_body("bob", mass=1.0, inertia=(1, 1, 1), pose=sw.pose((3, 0, 0.5)))
    drive = sw.PositionDrive(stiffness=10.0, damping=1.0)
    hinge = builder.add_joint_revolute(
        "hinge", sw.WORLD, bob, axis=(0, 1, 0), anchor=(3, 0, 1), damping=0.1, stiffness=1.0, friction=0.1,
        armature=0.01, limit=(-0.1, 0.1), drive=drive,
    )  # fmt: skip
    wheel = builder.add_shaft("wheel", inertia=1.0)
    builder.add_coupling("belt", [(hinge, 1.0), (wheel, -1.0)], damping=1.0)
    builder.add_shape_sphere(puck, radius=0.1)
    builder.add_shape_plane()
    return sw.Simulation(builder.finalize(WORLDS, "cpu", per_world=[name]), 1e-3)


@pytest.mark.quick("joint_friction", "shape_x", "joint_limit_upper")
@pytest.mark.parametrize("name", [name for name, field in PARAMETERS.items() if "int" not in str(field.dtype)])
def test_a_parameter_that_is_not_finite_is_named(name):
    there = puck_and_pendulum(name)
    array = getattr(there.model, name)
    values = array.numpy()
    if not values.size or values.dtype.kind != "f":
        pytest.skip("this model has none")
    untouched = puck_and_pendulum(name)
    values[BAD] = np.nan
    wp.copy(array, wp.array(values, dtype=array.dtype, device="cpu"))
    for sim in (there, untouched):
        sim.step(5)
    others = [world for world in range(WORLDS) if world != BAD]
    for field in ("body_x", "joint_q"):
        found, wanted = (getattr(sim.state, field).numpy()[others] for sim in (there, untouched))
        np.testing.assert_array_equal(found, wanted)
    told = [line for line in there.problems() if f"model.{name} holds nan" in line]
    assert len(told) == 1
    assert told[0].startswith(f"world {BAD}: ")
    assert not [line for line in untouched.problems() if "holds" in line]
