"""Granules on one clock that meet each other, in a slab of the machine that is periodic across the picture.

Comes in: packed granules in the order in which they come. Goes out: their states, step by step, and how they ended.
May call it: the tracker's front (``flight.driver``).
"""
