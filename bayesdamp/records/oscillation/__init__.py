"""What a record shows of its oscillation by itself: no law of damping or restoring force is assumed."""
