"""One candidate whose laws may hold approximately: draws of its posterior, and its evidence."""
