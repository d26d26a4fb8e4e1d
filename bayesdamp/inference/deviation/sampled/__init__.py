"""Posteriors of the motions themselves under laws that hold approximately."""
