"""The kinds of airflow: none, known, given by a user, steady, in time, a best estimate, in three dimensions.

Comes in: a Scene, its Plan, the cache. Goes out: a field and its key, its table of result.json, what is unknown of it.
May call it: ``flight.stages``, and what reports an airflow. ``every_kind`` has them all, registered.
"""
