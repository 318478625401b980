"""Watches buses, sensors and the recorder, and says what is wrong with them."""
