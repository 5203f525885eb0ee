"""Formulas: each a pure function with its source and range. numpy and, where the tracker uses them, numba alike."""
