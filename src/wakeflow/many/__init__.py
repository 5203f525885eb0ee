"""Many scenes: variants, sweeps, comparison.

Comes in: a scene and axes, or finished runs. Goes out: a table of results with its figures in one folder.
May call it: a user (``wf.sweep``, ``wf.compare``), the command line, extras.
"""
