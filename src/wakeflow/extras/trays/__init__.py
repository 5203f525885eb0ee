"""extras.trays."""
