"""Records of which only the envelope is known: reading, noise floor, free decay."""
