"""Published robots against MuJoCo: positions, masses, inverse masses, accelerations, swings, pairs. Skipped where the
files are not here.
"""

import copy
import functools
import warnings

import numpy as np
import pytest

import simwarp as sw
from simwarp.importers import load_mjcf

mujoco = pytest.importorskip("mujoco")
pytest.importorskip("lxml")

from tests.reference import robots  # noqa: E402  needs mujoco
from tests.reference.imported_robots import ROBOTS  # noqa: E402

MJCF = ROBOTS / "mjcf"
LOADED = {
    "2f85/2f85", "dm_control/acrobot", "dm_control/ball_in_cup", "dm_control/cartpole", "dm_control/cheetah",
    "dm_control/finger", "dm_control/hopper", "dm_control/humanoid", "dm_control/pendulum", "dm_control/point_mass",
    "dm_control/quadruped", "dm_control/reacher", "dm_control/walker", "go2/go2", "gymnasium/ant",
    "gymnasium/half_cheetah", "gymnasium/hopper", "gymnasium/humanoid", "gymnasium/inverted_double_pendulum",
    "gymnasium/inverted_pendulum", "gymnasium/pusher_v5", "gymnasium/reacher", "gymnasium/walker2d_v5",
    "mujoco_features/actuation/actuation", "mujoco_features/actuation/actuators", "mujoco_features/actuation/position",
    "mujoco_features/actuation/site", "mujoco_features/hfield/hfield", "mujoco_features/humanoid",
    "mujoco_features/tendon/fixed", "mujoco_features/tendon/tendon_limit", "panda/panda", "shadow_hand/right_hand",
    "ur5e/ur5e",
}  # fmt: skip
REFUSED = {
    "gymnasium/swimmer": ["density", "viscosity"],
    "mujoco_features/actuation/adhesion": ["adhesion"],
    "mujoco_features/actuation/muscle": ["muscle"],
    "mujoco_features/actuation/slidercrank": ["slidercrank"],
    "mujoco_features/actuation/tendon_force_limit": ["tendon actuatorfrcrange"],
    "mujoco_features/slider_crank": ["slidercrank"],
    "mujoco_features/tendon/armature": ["spatial tendon"],
    "mujoco_features/tendon/damping": ["spatial tendon"],
    "mujoco_features/tendon/fixed_site": ["spatial tendon"],
    "mujoco_features/tendon/pulley_fixed_site": ["spatial tendon"],
    "mujoco_features/tendon/pulley_site": ["spatial tendon"],
    "mujoco_features/tendon/pulley_site_fixed": ["spatial tendon"],
    "mujoco_features/tendon/pulley_wrap": ["spatial tendon"],
    "mujoco_features/tendon/site": ["spatial tendon"],
    "mujoco_features/tendon/site_fixed": ["spatial tendon"],
    "mujoco_features/tendon/wrap": ["spatial tendon"],
}
QUICK = ("2f85/2f85", "dm_control/humanoid", "go2/go2", "panda/panda", "gymnasium/walker2d_v5")
CLOSED = ("2f85/2f85",)
"""With closed loops, whose corrections are part of the accelerations."""
TIED = ("2f85/2f85", "dm_control/quadruped", "panda/panda")
"""With constraints that tie coordinates: MuJoCo's are soft, so that a swing differs by more than a step's error."""


def published(name):
    path = MJCF / f"{name}.xml"
    if not path.is_file():
        pytest.skip("the published model files are not here")
    return path


@functools.lru_cache(maxsize=2)
def both(name):
    path = published(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return robots.Pair(load_mjcf(path), mujoco.MjModel.from_xml_path(str(path)))


def test_every_file_is_loaded_or_refused():
    if not MJCF.is_dir():
        pytest.skip("the published model files are not here")
    found = {str(path.relative_to(MJCF).with_suffix("")) for path in MJCF.rglob("*.xml") if "common" not in path.parts}
    assert found == LOADED | set(REFUSED)


@pytest.mark.parametrize("name", REFUSED)
def test_a_refusal_names_all_kinds_and_what_is_left_loads(name):
    path = published(name)
    with pytest.raises(sw.ModelError, match="refused") as caught:
        load_mjcf(path)
    assert str(caught.value).endswith(f"drop them with allow={REFUSED[name]!r}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        robot = load_mjcf(path, allow=REFUSED[name])
    assert robot.builder.finalize(1, "cpu").body_count > 0


@pytest.mark.quick(*QUICK)
@pytest.mark.parametrize("name", sorted(LOADED))
def test_positions_and_masses(name):
    pair = both(name)
    qpos = pair.random_positions(64, 0)
    qvel = np.random.default_rng(0).normal(size=(64, pair.model.nv))
    assert np.abs(pair.mine.qpos_from(pair.mine.q_from(qpos)) - qpos).max() < 1e-12
    assert np.abs(pair.mine.qvel_from(pair.mine.qd_from(qvel, qpos), qpos) - qvel).max() < 1e-12
    place, turned = robots.pose_errors(pair, 64)
    assert place < 1e-6  # coordinates are set in float32
    assert turned < 1e-6
    assert robots.mass_errors(pair) < 1e-12


@pytest.mark.quick(*QUICK)
@pytest.mark.parametrize("name", sorted(LOADED))
def test_inverse_mass(name):
    pair = both(name)
    bound = 2e-5 if pair.model.nv > 30 else 1e-5  # float32, the more so the longer the sums
    assert robots.inverse_mass_error(pair) < bound


@pytest.mark.quick("dm_control/humanoid", "go2/go2", "gymnasium/walker2d_v5", "dm_control/quadruped")
@pytest.mark.parametrize("name", sorted(LOADED - set(CLOSED)))
def test_accelerations(name):
    # of a step of 1e-5 s, in which the poses move by as much of what turns them
    assert robots.acceleration_error(both(name)) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(LOADED - set(TIED)))
def test_a_free_swing(name):
    first, second, length = robots.swing_errors(both(name))
    assert first < 5e-3 * length
    assert second < 0.6 * first or second < 1e-5 * length  # of first order; or rounding


@pytest.mark.parametrize("name", sorted(LOADED))
@pytest.mark.sweep
def test_the_pairs_that_may_meet_are_those_of_mujoco(name):
    pair = both(name)
    assert robots.pairs_of_ours(pair) == robots.pairs_of_mujoco(pair)


RESTING = {"go2/go2": False, "dm_control/humanoid": True, "gymnasium/ant": True}
"""Robots that are left to themselves above the ground; True where they come to rest on the same geoms in both engines:
the legs of a dog without torque fold one way or the other.
"""


@pytest.mark.parametrize("name", RESTING)
def test_a_robot_at_rest_weighs_what_it_should(name):
    pair = on_ground(name)
    model, data = pair.model, pair.data
    model.opt.timestep, model.opt.integrator = 2e-3, int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    sim = pair.simulation(1, 2e-3)
    robots.set_positions(pair, sim, data.qpos[None].copy())
    shapes = pair.mine.builder.shapes
    ground = {slot for slot, shape in enumerate(shapes) if shape.type == sw.ShapeType.PLANE}
    weight = float(model.body_mass.sum()) * 9.81
    found = []
    for step in range(1500):
        sim.step()
        mujoco.mj_step(model, data)
        if step >= 1400:
            found.append(ground_force(sim, ground) / 2e-3)
    # what still rocks averages out over 0.2 s
    assert np.mean(found) == pytest.approx(weight, rel=5e-3)
    assert touching(sim, deepest=True) > -1e-3
    if RESTING[name]:
        names = [shape.name for shape in pair.mine.builder.shapes]
        mine = {tuple(sorted((names[low], names[high]))) for low, high in touching(sim)}
        theirs = {
            tuple(sorted(model.geom(geom).name or f"geom{geom}" for geom in (contact.geom1, contact.geom2)))
            for contact in data.contact
        }
        assert mine == theirs


def on_ground(name):
    """A robot of its own, on the floor of its file or on one that is added to both."""
    path = published(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mine = load_mjcf(path)
    spec = mujoco.MjSpec.from_file(str(path))
    if not any(shape.type == sw.ShapeType.PLANE for shape in mine.builder.shapes):
        mine.builder.add_shape_plane(name="ground", material=sw.Material(friction=1.0))
        spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    return robots.Pair(mine, spec.compile())


def ground_force(sim, ground):
    """Impulse along the normals of the contacts with the ground, in one step [N s]."""
    count = int(sim.contacts.contact_count.numpy()[0])
    pairs = zip(sim.contacts.contact_shape0.numpy()[0], sim.contacts.contact_shape1.numpy()[0], strict=True)
    impulses = sim.contacts.contact_impulse.numpy()[0, :, 0]
    return sum(float(impulses[k]) for k, two in enumerate(pairs) if k < count and ground & {int(s) for s in two})


def touching(sim, *, deepest=False):
    """Pairs of shapes that press on each other, or the smallest gap of a contact [m]."""
    count = int(sim.contacts.contact_count.numpy()[0])
    arrays = (sim.contacts.contact_shape0, sim.contacts.contact_shape1, sim.contacts.contact_impulse)
    first, second, impulse = (array.numpy()[0, :count] for array in arrays)
    if deepest:
        return float(sim.contacts.contact_gap.numpy()[0, :count].min())
    return {(int(a), int(b)) for a, b, force in zip(first, second, impulse[:, 0], strict=True) if force > 0.0}


def test_servos_of_an_arm_step_as_those_of_implicitfast():
    """A joint at a time is told to turn by 0.2 rad; the path stays within 2 % of it."""
    pair = both("ur5e/ur5e")
    model = copy.deepcopy(pair.model)
    model.opt.timestep, model.opt.integrator = 1e-3, int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    home = pair.model.key_qpos[0].copy()
    mine = pair.mine.builder.finalize(model.nu, "cpu")
    servos = sw.actuators.Actuators(mine, pair.mine.actuators)
    sim = sw.Simulation(mine, 1e-3, elements=[servos])
    robots.set_positions(pair, sim, np.tile(home, (model.nu, 1)))
    ctrl = np.tile(pair.model.key_ctrl[0], (model.nu, 1)) + 0.2 * np.eye(model.nu)
    servos.ctrl[:] = ctrl.astype(np.float32)
    datas = [mujoco.MjData(model) for _ in range(model.nu)]
    for world, data in enumerate(datas):
        data.qpos[:], data.ctrl[:] = home, ctrl[world]
    worst = 0.0
    for _ in range(500):
        sim.step()
        for data in datas:
            mujoco.mj_step(model, data)
        q = pair.mine.qpos_from(sim.state.joint_q.numpy())
        worst = max(worst, max(np.abs(q[world] - data.qpos).max() for world, data in enumerate(datas)))
    assert worst < 0.02 * 0.2
