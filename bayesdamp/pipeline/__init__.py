"""Run a study: compute its tasks, store their results, and write tables and report (`run` explains the word task)."""
