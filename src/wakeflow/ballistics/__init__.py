"""Flight without air: granules from impact to impact, in plain numpy. Parabolas between impacts, the one collision law
at each, sliding in between; exact but for how well roots are found.

It takes the arguments and gives the answer of the tracker in a vacuum, and shares the law of impact and the tables of
walls with it, nothing else. There are two because rung none has to start in a second: a new process has its first
granule down after 0.24 s of processor time. With the tracker it takes 1.1 s, and 28 s more on a machine that has not
compiled its kernel yet. Each holds the other to its answers (docs/validation.md, *Labyrinth*).
"""

from __future__ import annotations

from .course import follow

__all__ = ["follow"]
