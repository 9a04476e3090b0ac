"""Calibration: from pictures and logs of the sensor to the rig that the measurement believes."""
