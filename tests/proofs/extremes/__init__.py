"""Rows of the stability matrix: importing registers them."""

from proofs.extremes import contacts, granules, plain_scenes, scenes  # noqa: F401
