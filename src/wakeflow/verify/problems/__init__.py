"""Exact problems: a flow, granules and the answer, and reference integrators for what has no closed form."""
