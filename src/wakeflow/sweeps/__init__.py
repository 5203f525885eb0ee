"""Sweeps: many scenes, each stage once, one table; and the same table of runs that exist."""
