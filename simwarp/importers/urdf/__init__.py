"""URDF: the description format of ROS."""
