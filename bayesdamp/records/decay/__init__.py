"""Where a free decay stands in a record."""
