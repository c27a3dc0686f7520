"""MJCF: robots and scenes of MuJoCo, compiled by MuJoCo itself."""
