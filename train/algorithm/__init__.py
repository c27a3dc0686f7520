"""Learning algorithms: PPO with a KL penalty, cloning, training over several processes."""
