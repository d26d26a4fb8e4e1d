"""Represent what a file contains: its columns, its facts, and what their names mean."""
