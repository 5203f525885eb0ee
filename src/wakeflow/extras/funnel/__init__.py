"""The feed funnel bead by bead, with LIGGGHTS.

Comes in: the [funnel] table of a scene.
Goes out: its discharge rate with an interval, a FunnelSummary (planning.feed_funnel).
May call it: nobody by name; planning.feed_funnel has the registry of engines.
"""


def register() -> None:
    """Add the engine."""
    from ...planning.feed_funnel import ENGINE, bead_engines
    from .pour import Liggghts

    bead_engines.add(ENGINE, Liggghts())
