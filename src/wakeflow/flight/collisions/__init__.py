"""Crowds: granules on one clock that meet each other, in a slab of the machine that is periodic across the picture."""
