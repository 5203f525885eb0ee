"""An airflow over a span, resolved in three dimensions: its run, its means, and the layers that it leaves.

Comes in: a solved plane case and a FlowSpec with a span. Goes out: snapshots of layers, means over time and span.
May call it: ``kinds`` (``solved_air``).
"""
