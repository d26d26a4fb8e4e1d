"""The damping of an envelope: its noise, its sums of damping terms, and their posterior."""
