"""Exact problems: a flow, granules and the answer; reference integrators where there is no closed form."""
