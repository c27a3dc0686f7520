"""Device halves of kinematics."""
