"""Random numbers by count: each a pure function of a seed, a stream and its number in the stream, whatever was drawn
before, in which order and by which thread.
"""

from __future__ import annotations

from typing import Any

import numpy as np

G1, G2, G3 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
S27, S30, S31, S11 = np.uint64(27), np.uint64(30), np.uint64(31), np.uint64(11)
UNIT = 2.0**-53


def _scramble(x: Any) -> Any:
    """The finaliser of splitmix64 (Steele, Lea & Flood 2014, OOPSLA): a bijection of 64 bits that looks random."""
    x = (x ^ (x >> S30)) * G2
    x = (x ^ (x >> S27)) * G3
    return x ^ (x >> S31)


def _key(seed: Any, stream: Any, draw: Any) -> Any:
    """64 bits of the three numbers, of which the last one says which number of the stream it is."""
    one = np.uint64(1)
    key = _scramble(np.uint64(seed) + G1)
    key = _scramble(key + (np.uint64(stream) + one) * G1)
    return _scramble(key + (np.uint64(draw) + one) * G1)


def uniform(seed: Any, stream: Any, draw: Any) -> Any:
    """A number uniform from 0 to 1, independent of the pair of :func:`normal_pair` of the same arguments."""
    return (_scramble(_key(seed, stream, draw) + G2) >> S11) * UNIT


def normal_pair(seed: Any, stream: Any, draw: Any) -> Any:
    """Two independent standard normal numbers (Box & Muller 1958), a pure function of its arguments.

    ``seed``, ``stream`` and ``draw``: whole numbers; scalars in the tracker's compiled kernel, int64 arrays of one
    shape elsewhere (a numpy scalar would warn of the overflow that is meant). The bits are mixed by the finaliser of
    splitmix64.
    """
    key = _key(seed, stream, draw)
    u = ((key >> S11) + 0.5) * UNIT
    v = (_scramble(key + G1) >> S11) * UNIT
    r = np.sqrt(-2.0 * np.log(u))
    return r * np.cos(2.0 * np.pi * v), r * np.sin(2.0 * np.pi * v)
