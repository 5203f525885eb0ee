"""The chain: granules from impact to impact without air, in plain numpy. Parabolas between impacts, the one collision
law at each, sliding in between; exact but for how well roots are found.

Same arguments and same answer as the tracker in a vacuum, without its compiler: it starts at once.
"""

from __future__ import annotations

from .course import follow

__all__ = ["follow"]
