"""Messages of ROS 2 from a simulation, and the bridge to a running ROS 2: `simwarp ros2 TARGET`.

Recordings (`simwarp.mcap`) and the bridge send the same messages. Only `rclpy_node` imports ROS.
"""
