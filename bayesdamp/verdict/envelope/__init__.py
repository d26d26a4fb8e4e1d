"""From a weighed envelope to its verdict."""
