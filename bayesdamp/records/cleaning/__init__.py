"""From a raw record to a signal: clock, zero, outliers, thinning, recording step."""
