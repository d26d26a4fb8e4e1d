"""What a run's folder holds, read once and put into order and words."""
