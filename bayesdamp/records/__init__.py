"""Records: reading, cleaning, their plain features, and simulated ones."""
