"""Ways to move through the pipe: one file each, one line here; each turns settings into the truth."""
