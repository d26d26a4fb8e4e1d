"""What is computed of several records together."""
