"""Contacts by name: forces of what stands, times in air and in contact, checkpoints, and names that do not exist."""

import dataclasses

import pytest
import torch

import simwarp as sw
from simwarp.tasks import InputError, Range, Task, TaskConfig

G = 9.81


@dataclasses.dataclass(frozen=True)
class BallsConfig(TaskConfig):
    """A control step of 20 ms."""

    dt: float = 0.005
    decimation: int = 4
    max_episode_steps: int = 40


class BallsTask(Task[BallsConfig]):
    """A ball of 2 kg at rest, and one of 1 kg that falls from half a metre."""

    config_type = BallsConfig
    action_size = 1
    threshold = 1.0
    names: tuple[str, ...] = ("resting ball", "falling ball")

    def build(self, builder):
        builder.add_shape_plane(sw.WORLD, name="floor", group=2)
        for name, mass, height in (("resting", 2.0, 0.1), ("falling", 1.0, 0.6)):
            body = builder.add_body(
                name, mass=mass, inertia=(0.01,) * 3, pose=sw.pose((mass, 0.0, height))
            )  # fmt: skip
            builder.add_shape_sphere(body, radius=0.1, name=f"{name} ball", mask=2)

    def setup(self):
        self.felt = self.contacts(*self.names, threshold=self.threshold)

    def apply(self, action):
        self.views.body_force[:, 1, 2] = 30.0 * action[:, 0]

    def observations(self):
        return {"policy": self.felt.time_in_air}

    def rewards(self):
        return {"none": torch.zeros(self.num_worlds, device=self.device)}

    def terminations(self):
        return {}

    def reset(self, world_mask):
        pass


def still(task):
    return torch.zeros(task.num_worlds, 1)


def test_forces_are_weights_and_times_are_those_of_a_fall():
    task = BallsTask(BallsConfig(), 2)
    felt = task.felt
    landing = (2.0 * 0.5 / G) ** 0.5  # 0.319 s: in the 16th control step
    for step in range(1, 31):
        task.step(still(task))
        time = 0.02 * step
        landed = time > landing
        assert felt.touching[0].tolist() == [True, landed]
        assert felt.time_in_contact[0, 0].item() == pytest.approx(time, abs=1e-5)
        assert felt.time_in_air[0, 1].item() == pytest.approx(0.0 if landed else time, abs=1e-5)
        if step == 16:
            # It touched the ground in this step, for the first time after fifteen in the air
            assert felt.landed[0].tolist() == pytest.approx([0.0, 0.30], abs=1e-5)
        else:
            assert felt.landed[0].tolist() == [0.0, 0.0]
        # The solve stops at 1e-5 m/s: of 2 kg in 5 ms that is 4 mN, and what is left of one step comes in the next
        assert felt.force[0, 0].tolist() == pytest.approx([0.0, 0.0, 2.0 * G], abs=0.01)
    assert felt.force[0, 1].tolist() == pytest.approx([0.0, 0.0, G], abs=0.01)


def test_parts_are_where_they_are_and_move_as_they_do():
    task = BallsTask(BallsConfig(), 1)
    for _ in range(5):
        task.step(still(task))
    speed = -G * 0.1
    assert task.felt.velocity()[0].tolist() == [
        pytest.approx([0.0] * 3, abs=1e-4),
        pytest.approx([0.0, 0.0, speed]),
    ]
    place = task.felt.position()[0, 1].tolist()
    # Semi-implicit Euler falls by half a step's speed more, over 0.1 s
    assert place == pytest.approx([1.0, 0.0, 0.6 - 0.5 * G * 0.1 * (0.1 + 0.005)], abs=1e-5)


def test_points_of_turning_bodies_move_by_their_arm():
    class Rod(BallsTask):
        def build(self, builder):
            turned = (0.0, 0.0, 0.7071068, 0.7071068)
            rod = builder.add_body(
                "rod", mass=1.0, inertia=(1.0,) * 3, pose=sw.pose((0.0, 0.0, 5.0), turned), omega=(0.0, 3.0, 0.0)
            )
            builder.add_body("other", mass=1.0, inertia=(1.0,) * 3)
            builder.add_shape_sphere(rod, radius=0.1, name="tip", pose=sw.pose((0.0, 0.5, 0.0)))

        names = ("tip",)

    task = Rod(BallsConfig(), 1)
    # The body's y is -x of the world: r = (-0.5, 0, 0), omega x r = (0, 3, 0) x r = (0, 0, 1.5)
    assert task.felt.position()[0, 0].tolist() == pytest.approx([-0.5, 0.0, 5.0], abs=1e-6)
    assert task.felt.velocity()[0, 0].tolist() == pytest.approx([0.0, 0.0, 1.5], abs=1e-5)


def test_a_body_feels_the_sum_of_its_shapes():
    class Bodies(BallsTask):
        names = ("resting", "falling")

    task, other = Bodies(BallsConfig(), 1), BallsTask(BallsConfig(), 1)
    for _ in range(25):
        task.step(still(task))
        other.step(still(other))
    assert torch.equal(task.felt.force, other.felt.force)


def test_a_threshold_is_a_force():
    class Deaf(BallsTask):
        threshold = 15.0

    task = Deaf(BallsConfig(), 1)
    for _ in range(30):
        task.step(still(task))
    assert task.felt.touching[0].tolist() == [True, False]  # 19.6 N and 9.8 N


def test_worlds_that_begin_anew_have_no_contacts_and_others_keep_theirs():
    task = BallsTask(BallsConfig(), 3)
    for _ in range(30):
        task.step(still(task))
    before = {name: values.clone() for name, values in task.felt.state().items()}
    mask = torch.tensor([False, True, False])
    task.begin_episodes(mask)
    for name, values in task.felt.state().items():
        assert (values[1] == 0).all()
        assert torch.equal(values[[0, 2]], before[name][[0, 2]])


def test_a_checkpoint_keeps_times():
    task, other = BallsTask(BallsConfig(), 2, seed=1), BallsTask(BallsConfig(), 2, seed=5)
    for _ in range(13):
        task.step(still(task))
    state = task.state_dict()
    expected = [task.step(still(task)).observations["policy"].clone() for _ in range(40)]
    other.load_state_dict(state)
    for each in expected:
        assert torch.equal(other.step(still(other)).observations["policy"], each)
    assert not torch.equal(expected[0], expected[10])


def test_worlds_do_not_feel_each_other():
    task, alone = BallsTask(BallsConfig(), 4), BallsTask(BallsConfig(), 4)
    for _ in range(30):
        push = still(task)
        push[3] = 1.0
        task.step(push)
        alone.step(still(alone))
    for name, values in task.felt.state().items():
        assert torch.equal(values[:3], alone.felt.state()[name][:3])
    assert not torch.equal(task.felt.time_in_air[3], alone.felt.time_in_air[3])


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("restin ball",), "there is no shape or body 'restin ball' whose contacts could be felt"),
        ((), "contacts need names of shapes or bodies"),
        (("falling", "resting ball"), "asked for apart, got the body 'falling' among shapes"),
        (("floor",), "'floor', which is fixed to the world"),
    ],
)
def test_wrong_names_are_told(names, message):
    wrong = type("Wrong", (BallsTask,), {"names": names})
    with pytest.raises(InputError, match=message):
        wrong(BallsConfig(), 1)


def test_a_threshold_cannot_be_negative():
    wrong = type("Wrong", (BallsTask,), {"threshold": -1.0})
    with pytest.raises(InputError, match="threshold of contacts must be 0 N or more"):
        wrong(BallsConfig(), 1)


def test_shapes_are_where_they_are_though_the_centre_of_mass_is_drawn():
    """The body stays; what moves within it is the origin that its shapes are told from."""

    class Carried(BallsTask):
        name = "carried"

        def build(self, builder):
            builder.add_shape_plane(sw.WORLD, name="floor")
            body = builder.add_body("box", mass=1.0, inertia=(0.01,) * 3, pose=sw.pose((0.0, 0.0, 1.0)))
            builder.add_shape_sphere(body, radius=0.05, pose=sw.pose((0.3, 0.0, 0.0)), name="foot")
            builder.add_joint_free("free", body)

        def setup(self):
            self.felt = self.contacts("foot")

        def apply(self, action):
            pass

    shift = {"body_com_x": Range(-0.1, 0.1, mode="add")}
    task = Carried(BallsConfig(randomise=shift), 4)
    centres = task.views.body_q[:, 0, 0]
    assert centres.unique().numel() == 4
    assert torch.allclose(task.felt.position()[:, 0, 0], torch.full((4,), 0.3), atol=1e-6)
