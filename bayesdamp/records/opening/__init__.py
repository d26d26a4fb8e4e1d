"""The border to files: opening them, in a process of its own where a reader may crash."""
