"""Clean a raw record: choose clock and window, subtract the sensor's zero, reduce samples."""
