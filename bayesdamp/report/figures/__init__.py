"""The report's figures: functions from arrays to a matplotlib figure, one kind a file."""
