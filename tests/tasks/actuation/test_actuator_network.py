"""Learned actuators: a network of a known law is that law, histories and resets are as told, others are refused."""

from __future__ import annotations

import pytest
import torch

from simwarp.tasks import ActuatorNetwork, InputError, make
from simwarp.tasks.actuation.actuator_network import load_actuator_network
from tests.tasks.actuation.hinge_task import JOINTS, LIMIT, hinges

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # TorchScript is old, and what such files are


def saved(path, weights, bias=0.0):
    """The file of a linear law."""
    network = torch.nn.Linear(len(weights), 1)
    with torch.no_grad():
        network.weight.copy_(torch.tensor([weights]))
        network.bias.fill_(bias)
    torch.jit.save(torch.jit.script(network), str(path))
    return str(path)


def test_a_linear_network_is_a_pd_controller_and_looks_back(tmp_path):
    # errors now and two steps ago, then rates of the same: history=(0, 2)
    weights = (7.0, 2.0, -0.3, -0.1)
    task = hinges(3, seed=2, network=saved(tmp_path / "pd.pt", weights))
    task.restart(seed=2)
    errors, rates, torques = [], [], []
    steps = task.config.decimation
    actions = torch.rand(5, 3, 2, generator=torch.Generator().manual_seed(1)) * 2 - 1
    inner = task.simulation.step

    class Watching:
        """Notes what the joints are before each physics step."""

        def __getattr__(self, name):
            return getattr(task_simulation, name)

        def step(self):
            errors.append(task.learned.target - task.views.joint_q)
            rates.append(task.views.joint_qd.clone())
            torques.append(task.views.joint_force.clone())
            inner()

    task_simulation = task.simulation
    task.simulation = Watching()
    for action in actions:
        task.step(action)
    assert len(torques) == 5 * steps
    zero = torch.zeros(3, 2)
    for index, torque in enumerate(torques):
        old = (errors[index - 2], rates[index - 2]) if index > 1 else (zero, zero)
        law = weights[0] * errors[index] + weights[1] * old[0] + weights[2] * rates[index] + weights[3] * old[1]
        torch.testing.assert_close(torque, law.clamp(-LIMIT, LIMIT), rtol=1e-5, atol=1e-5)
    assert float(torch.stack(torques).abs().max()) == LIMIT
    assert float(torch.stack(torques).abs().min()) < LIMIT


def test_it_forgets_where_an_episode_begins_and_resumes_bit_by_bit(tmp_path):
    path = saved(tmp_path / "law.pt", (3.0, 5.0, -0.2, 0.1), 0.05)
    task = hinges(3, seed=2, network=path)
    actions = torch.rand(20, 3, 2, generator=torch.Generator().manual_seed(1)) * 2 - 1
    for action in actions[:6]:
        task.step(action)
    mask = torch.tensor([False, True, False])
    kept = {name: tensor.clone() for name, tensor in task.extra_state().items()}
    task.begin_episodes(mask)
    for name, tensor in task.extra_state().items():
        assert not tensor[1].any(), name
        assert torch.equal(tensor[[0, 2]], kept[name][[0, 2]])
    state = task.state_dict()
    expected = [task.step(action).observations["policy"].clone() for action in actions[6:]]
    other = hinges(3, seed=7, network=path)
    other.load_state_dict(state)
    got = [other.step(action).observations["policy"].clone() for action in actions[6:]]
    assert all(torch.equal(a, b) for a, b in zip(expected, got, strict=True))


def test_worlds_do_not_meet_and_strength_is_their_own(tmp_path):
    path = saved(tmp_path / "law.pt", (3.0, 0.0, -0.2, 0.0))
    found = []
    for weaker in (False, True):
        task = hinges(3, seed=2, network=path)
        task.restart(seed=2)
        if weaker:
            task.learned.strength[2] = 0.5
        for _ in range(4):
            result = task.step(torch.full((3, 2), 0.8))
        found.append(result.observations["policy"].clone())
    assert torch.equal(found[0][:2], found[1][:2])
    assert not torch.equal(found[0][2], found[1][2])


def test_limited_actions_ask_once_in_each_physics_step(tmp_path):
    task = hinges(2, network=saved(tmp_path / "law.pt", (3.0, 0.0, 0.0, 0.0)), action_rise_time=0.1)
    calls = 0
    inner = task.learned._act

    def counted():
        nonlocal calls
        calls += 1
        inner()

    task.learned._act = counted
    task.step(torch.ones(2, 2))
    assert calls == task.config.decimation


class TwoOutputs(torch.nn.Module):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x[:, :2]


class Broken(torch.nn.Module):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x[:, :1] / x[:, :1]


def test_files_that_are_no_actuators(tmp_path):
    path = tmp_path / "net.pt"
    with pytest.raises(InputError, match="there is no such file"):
        load_actuator_network(path, 6)
    path.write_bytes(b"no network")
    with pytest.raises(InputError, match="must be TorchScript") as caught:
        load_actuator_network(path, 6)
    assert "\n" not in str(caught.value)
    torch.save({"weights": torch.zeros(3)}, path)
    with pytest.raises(InputError, match="must be TorchScript") as caught:
        load_actuator_network(path, 6)
    assert "\n" not in str(caught.value)
    saved(path, (1.0,) * 5)
    with pytest.raises(InputError, match="must take rows of 6 numbers"):
        load_actuator_network(path, 6)
    torch.jit.save(torch.jit.script(TwoOutputs()), str(path))
    with pytest.raises(InputError, match=r"one float32 for each of 3 rows, got torch.float32 of shape \(3, 2\)"):
        load_actuator_network(path, 6)
    torch.jit.save(torch.jit.script(Broken()), str(path))
    with pytest.raises(InputError, match="must return finite numbers at zero"):
        load_actuator_network(path, 6)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"joints": ("left", "middle")}, "has no joint 'middle'"),
        ({"joints": "left"}, "joints must be a list of names"),
        ({"history": (0, -1)}, "history must be different whole numbers"),
        ({"history": ()}, "history must be different whole numbers"),
        ({"effort_limit": 0.0}, "effort_limit must be > 0"),
    ],
)
def test_options_are_checked(tmp_path, options, words):
    task = hinges(2)
    given = {"joints": JOINTS, **options}
    with pytest.raises(InputError, match=words):
        ActuatorNetwork(task, saved(tmp_path / "net.pt", (1.0,) * 6), **given)


def test_joints_with_a_drive_and_tasks_without_physics_are_refused(tmp_path):
    path = saved(tmp_path / "net.pt", (1.0,) * 6)
    with pytest.raises(InputError, match="joint 'left' has a PositionDrive already"):
        ActuatorNetwork(hinges(1, driven=True), path, ["left"])
    with pytest.raises(InputError, match="has no physics"):
        ActuatorNetwork(make("fast", 1), path, ["left"])
