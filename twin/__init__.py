"""THE WORLD, which knows the truth: pipe, robot, and what really happened."""
