"""Granules up to the first contact: what they meet first, eq. (1)-(2) of the paper, the loads of impacts.

Comes in: a Scene, its Plan, random numbers. Goes out: Granules in the field, and what the stream does to the body.
May call it: ``stages``, and pictures that count from the first contact.
"""
