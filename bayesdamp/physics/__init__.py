"""Define damping terms, restoring laws and the motion, without any knowledge of data."""
