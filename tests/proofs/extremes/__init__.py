"""Rows of the stability matrix that need a reference, OpenFOAM or much time: importing registers them."""

from proofs.extremes import contacts, granules, scenes  # noqa: F401
