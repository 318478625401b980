"""What a CAN frame means: frames, DBC databases, decoding, units."""
