"""Read the contents of a run's folder, and put them in order and into words."""
