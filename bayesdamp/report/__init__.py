"""Write the report of a run: draw and describe the stored results, without computing any statistics."""
