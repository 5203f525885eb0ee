"""extras/funnel/beads.py."""
