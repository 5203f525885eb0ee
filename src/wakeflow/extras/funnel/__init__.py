"""extras.funnel."""
