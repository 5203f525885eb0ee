"""air.foam.spanwise."""
