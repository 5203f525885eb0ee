"""The compiled equation of motion: one granule from its release to its end. Everything here is compiled by numba."""
