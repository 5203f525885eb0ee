"""air/kinds/every_kind.py."""
