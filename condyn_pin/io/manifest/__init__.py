"""Cards: what a robot.toml says of a robot, and the robot that it makes."""
