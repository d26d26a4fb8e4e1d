"""Read the results of a run, and prepare them for the sections of its report."""
