"""extras.search."""
