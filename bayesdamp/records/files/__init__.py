"""Represent what a file contains: its columns, its facts (named numbers and texts), and what their names mean."""
