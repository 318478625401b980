"""The vehicle as matrices, sensors and facts."""
