"""Tasks as environments of other libraries: Gymnasium, Stable-Baselines3, skrl."""
