"""Proof: the error of a scene against its run time, and what happens at the ends of what can be asked for."""
