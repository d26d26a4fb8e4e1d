"""The mode of a posterior: where searches start, how they climb, what is chosen of noise and friction."""
