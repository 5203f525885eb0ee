"""Formulas: each a pure function with its source and range. numpy and, where the tracker uses them, numba alike.

Comes in: numbers in SI units. Goes out: numbers in SI units, and data (materials, wakes), each with its source. Nothing
here knows a scene.
May call it: a user (``wakeflow.laws``), every room after it.
"""
