"""Define damping terms and restoring laws, and solve the equation of motion. Nothing here depends on recorded data."""
