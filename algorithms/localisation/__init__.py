"""Where the sensor is: travel from the encoders, roll from the IMU."""
