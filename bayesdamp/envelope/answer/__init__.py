"""From a decay and its damping sums to what is said of it."""
