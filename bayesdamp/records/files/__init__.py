"""Files as they are: opening them, the columns and facts in them, and which of these are a record."""
