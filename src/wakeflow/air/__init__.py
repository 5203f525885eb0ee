"""The air: a mesh, OpenFOAM's airflow on it, the field that granules fly through, the kinds that a plan asks for.

Comes in: a Scene and its Plan. Goes out: a FlownAir, with its field and key, its numbers, the parts of its error that
are not known. Its folders are rooms, each of which imports only those before it: mesh, foam, field, kinds.
May call it: every room after it.
"""
