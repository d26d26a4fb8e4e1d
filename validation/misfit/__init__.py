"""Test whether answers are right, or give a warning, on records that no law fits and on records of poor quality."""
