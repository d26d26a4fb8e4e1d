"""The report of a run's folder: draw and describe what the store contains, without computing any statistics."""
