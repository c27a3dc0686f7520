"""Device halves of the robot arms."""
