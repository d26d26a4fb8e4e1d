"""Define the commands; each imports what it needs when it is run."""
