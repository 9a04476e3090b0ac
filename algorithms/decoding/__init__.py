"""The steps from a picture to named slit pixels; `algorithms.decode` calls them in turn."""
