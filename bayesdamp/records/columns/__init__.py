"""Which columns of a file are a record, and in which units."""
