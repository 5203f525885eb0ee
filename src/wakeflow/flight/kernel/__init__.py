"""The compiled equation of motion: one granule from its release to its end. Everything here is compiled by numba.

Comes in: packed arrays (``layout``). Goes out: the same arrays, filled.
May call it: the tracker's front (``flight.driver``) and ``collisions``.
"""
