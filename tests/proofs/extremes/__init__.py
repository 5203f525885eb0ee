"""Rows of the stability matrix that need a reference integrator, OpenFOAM or much time: importing registers them."""

from proofs.extremes import airflows, contacts, granules  # noqa: F401
