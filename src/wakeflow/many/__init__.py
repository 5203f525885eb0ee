"""Many scenes: sweeps, comparison, sensitivity and design search."""
