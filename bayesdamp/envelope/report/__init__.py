"""What is written of a comparison of envelopes."""
