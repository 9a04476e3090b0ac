"""THE SENSOR: truth in, measurements out."""
