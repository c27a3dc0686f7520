"""PPO in one file, as CleanRL writes it: torch alone, directly over a task's tensors, all worlds at once.

Run: python examples/train_cleanrl_style.py --task pendulum --worlds 64 --steps 200000
"""

from __future__ import annotations

import argparse
from typing import Any

import torch
from torch import nn
from torch.distributions import Normal

from simwarp.tasks import Task, make, resolve_device

ROLLOUT, EPOCHS, PARTS, GAMMA, LAMBDA, CLIP, RATE, LARGEST_GRADIENT = 32, 5, 4, 0.99, 0.95, 0.2, 1e-3, 0.5


def layers(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


class Agent(nn.Module):
    """Actor and critic by perceptrons, one deviation per component of the action."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.actor, self.critic = layers(inputs, outputs), layers(inputs, 1)
        self.log_std = nn.Parameter(torch.zeros(outputs))

    def value(self, seen: torch.Tensor) -> torch.Tensor:
        """Return (W,) values of (W, N) observations."""
        return self.critic(seen).squeeze(-1)

    def policy(self, seen: torch.Tensor) -> Normal:
        """Return the distribution of (W, A) actions."""
        return Normal(self.actor(seen), self.log_std.exp())


@torch.no_grad()
def roll_out(task: Task[Any], agent: Agent, seen: torch.Tensor) -> tuple[list[torch.Tensor], torch.Tensor]:
    """Return (T W, ...) observations, actions, log probabilities, advantages and returns; and the next observation."""
    steps = []
    for _ in range(ROLLOUT):
        seen = seen.clone()  # the task's own buffer: the next step writes it
        policy, value = agent.policy(seen), agent.value(seen)
        action = policy.sample()
        result = task.step(action)
        assert result.final_observations is not None
        # What followed the action; where an episode ended, `observations` are those of the next one
        ended = result.terminated | result.truncated
        follows = torch.where(ended[:, None], result.final_observations["policy"], result.observations["policy"])
        # A failure is worth nothing more; a time-out is worth what the state would have brought
        future = GAMMA * agent.value(follows) * ~result.terminated
        error = result.rewards + future - value
        steps.append((seen, action, policy.log_prob(action).sum(1), value, error, ~ended))
        seen = result.observations["policy"]
    seens, actions, log_probs, values, errors, running = (torch.stack(column) for column in zip(*steps, strict=True))
    advantages, carried = torch.zeros_like(errors), torch.zeros_like(errors[0])
    for step in reversed(range(ROLLOUT)):
        carried = errors[step] + GAMMA * LAMBDA * running[step] * carried
        advantages[step] = carried
    return [column.flatten(0, 1) for column in (seens, actions, log_probs, advantages, advantages + values)], seen


def learn(agent: Agent, optimizer: torch.optim.Optimizer, batch: list[torch.Tensor]) -> None:
    """Take some epochs of clipped steps on a batch."""
    for _ in range(EPOCHS):
        for rows in torch.randperm(len(batch[0]), device=batch[0].device).chunk(PARTS):
            seen, action, log_prob, advantage, goal = (column[rows] for column in batch)
            ratio = (agent.policy(seen).log_prob(action).sum(1) - log_prob).exp()
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
            gain = torch.minimum(ratio * advantage, ratio.clamp(1.0 - CLIP, 1.0 + CLIP) * advantage).mean()
            loss = 0.5 * (agent.value(seen) - goal).square().mean() - gain
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), LARGEST_GRADIENT)
            optimizer.step()


@torch.no_grad()
def mean_return(agent: Agent, task: Task[Any]) -> float:
    """Return the mean return of the first episodes of fresh worlds, with the mean action."""
    seen = task.restart(seed=1_000_003)["policy"]
    total, running = torch.zeros_like(seen[:, 0]), torch.ones_like(seen[:, 0])
    while running.any():
        result = task.step(agent.actor(seen))
        seen = result.observations["policy"]
        total += running * result.rewards
        running *= ~(result.terminated | result.truncated)
    return float(total.mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="pendulum", help="with observations in one group")
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--steps", type=int, default=200_000, help="environment steps of all worlds")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="auto")
    args = parser.parse_args()

    torch.manual_seed(args.seed)
    torch.set_num_threads(1)  # such small networks gain nothing from more
    task, unseen = (make(args.task, args.worlds, seed=args.seed, device=resolve_device(args.device)) for _ in range(2))
    agent = Agent(task.observation_shapes["policy"][0], task.action_size).to(task.device)
    optimizer = torch.optim.Adam(agent.parameters(), lr=RATE, eps=1e-5)
    before = mean_return(agent, unseen)
    seen, done = task.restart(seed=args.seed)["policy"], 0
    while done < args.steps:
        batch, seen = roll_out(task, agent, seen)
        learn(agent, optimizer, batch)
        done += len(batch[0])
    print(f"mean return before {before:.1f}, after {done} steps {mean_return(agent, unseen):.1f}")


if __name__ == "__main__":
    main()
