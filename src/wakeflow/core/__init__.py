"""The machine: files and the cache, outside programs, errors, registries, plane geometry.

Comes in: bytes, texts and arrays. Goes out: numbers with units and intervals, stages that are whole or absent, errors.
It knows neither granules nor OpenFOAM.
May call it: every room.
"""
