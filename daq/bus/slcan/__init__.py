"""Serial-line CAN adapters read in blocks."""
