"""Laws of decay of an envelope, its noise, and the evidence of its candidates."""
