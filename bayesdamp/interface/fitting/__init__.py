"""A model on a record: what is asked, and how it is fitted."""
