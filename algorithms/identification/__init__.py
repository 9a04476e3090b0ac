"""What a log alone tells of the sensor, the robot and the pipe that wrote it: one group of quantities a file."""
