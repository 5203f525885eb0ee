"""runs/planned.py."""
