"""Clean a raw record: choose its clock and its free decay, subtract the sensor's zero, reduce the samples."""
