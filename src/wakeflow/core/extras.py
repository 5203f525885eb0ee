"""core/extras.py."""
