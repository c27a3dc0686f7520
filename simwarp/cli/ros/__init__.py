"""``simwarp ros2``: a task, a vehicle, a robot or a scene in ROS 2."""
