"""Stable-Baselines3 trains on a task: PPO, all worlds of one process; needs `pip install 'simwarp[sb3]'`.

Run: python examples/train_sb3.py --task pendulum --worlds 64 --steps 200000
"""

from __future__ import annotations

import argparse

from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy

from simwarp.tasks.adapters.sb3_adapter import SB3VecEnv


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="pendulum")
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--steps", type=int, default=200_000, help="environment steps of all worlds")
    parser.add_argument("--episodes", type=int, default=32, help="episodes of the evaluations")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()

    env = SB3VecEnv(args.task, args.worlds, seed=args.seed)
    unseen = SB3VecEnv(args.task, args.worlds, seed=1_000_003)
    model = PPO("MlpPolicy", env, n_steps=32, batch_size=512, learning_rate=1e-3, seed=args.seed, device="cpu")

    before, _ = evaluate_policy(model, unseen, args.episodes, warn=False)
    model.learn(args.steps)
    after, _ = evaluate_policy(model, unseen, args.episodes, warn=False)
    print(f"mean return before {before:.1f}, after {model.num_timesteps} steps {after:.1f}")


if __name__ == "__main__":
    main()
