"""What an error would be with other settings, from what it is with those of a finished round.

Sampling falls with the granules as n^-RATE: plain Monte Carlo would give 1/2, balanced samples of few dimensions up to
1 (Owen 1997, SIAM J. Numer. Anal. 34, 1884); the rate between them is assumed, not fitted. What is an upper
limit of a counted share (steps, terms left out) is read back to the share and limited again: with few granules the
limit is most of it.
"""

from __future__ import annotations

from math import sqrt

from ..planning.unknowns import SIGMAS
from ..results.refinement import KnobSettings

RATE = 0.6  # of sampling with the number of granules; assumed


def landed(settings: KnobSettings) -> int:
    """Granules of a fraction whose landings make the shares."""
    return settings.granules if settings.slab is None else settings.slab


def sampled(error: float, now: KnobSettings, then: KnobSettings) -> float:
    """An ``error`` that goes as sampling does."""
    return error * float((landed(now) / landed(then)) ** RATE)


def averaged(now: KnobSettings, then: KnobSettings) -> float:
    """The factor on what the finite averages of a wake make of an error."""
    return 1.0 if now.averaging is None or then.averaging is None else then.averaging / now.averaging


def limited_again(limit: float, count: float, again: float, times: float = 1.0) -> float:
    """The upper 95 % limit of a share from ``again`` granules that is ``times`` the one whose limit from ``count`` is
    ``limit`` (Wilson's, solved for the share: it lies SIGMAS standard errors of the limit below it).
    """
    share = min(1.0, times * max(0.0, limit - SIGMAS * sqrt(limit * (1.0 - limit) / count)))
    beyond = SIGMAS**2 / again
    spread = SIGMAS * sqrt(share * (1.0 - share) / again + beyond / (4.0 * again))
    return (share + 0.5 * beyond + spread) / (1.0 + beyond)
