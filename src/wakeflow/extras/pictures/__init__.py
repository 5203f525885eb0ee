"""extras.pictures."""
