"""Computed airflows beside published values."""
