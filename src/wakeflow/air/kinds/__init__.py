"""air.kinds."""
