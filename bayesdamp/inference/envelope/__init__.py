"""Infer damping from an envelope (amplitude against time): noise, evidence of sums of damping terms, decay rates."""
