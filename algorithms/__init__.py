"""THE MEASUREMENT: what runs on the robot; it never sees the truth."""
