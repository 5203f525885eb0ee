"""The stages of a scene: airflow, force on it, tracks, slab, draws, each cached.

Comes in: a Scene and its Plan. Goes out: a Pipeline, which makes each stage at most once: Airflow, Landings, Tracked.
May call it: every room after it.
"""
