"""The colours of fractions: a fraction has the same one in every picture of every run, and any two stay apart."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

# Okabe & Ito (2008), "Color Universal Design", without its yellow, too pale for a line, and with a grey and a brown.
# tests/report/test_colours.py measures how far apart they are seen, with any kind of colour vision.
AMBER, BLUE, VERMILION, GREY = "#E69F00", "#0072B2", "#D55E00", "#555555"
GREEN, SKY, PINK, BROWN, BLACK = "#009E73", "#56B4E9", "#CC79A7", "#6B3D00", "#000000"
COLOURS = (BLUE, VERMILION, GREEN, AMBER, GREY, PINK, SKY, BROWN, BLACK)
KNOWN = {  # what a cleaner meets: the four that are fed together most often are the farthest apart
    "wheat": AMBER,
    "chaff": BLUE,
    "straw": VERMILION,
    "dust": GREY,
    "barley": GREEN,
    "rapeseed": PINK,
    "glass-beads": SKY,
}


def fraction_colours(names: Sequence[str]) -> dict[str, str]:
    """One colour a fraction, by its name: that of :data:`KNOWN`, else one that the name alone decides, or the next that
    no other of ``names`` has. Beyond nine fractions colours come again.
    """
    found = {name: KNOWN[name] for name in names if name in KNOWN}
    for name in sorted(set(names) - set(found)):
        first = zlib.crc32(name.encode()) % len(COLOURS)
        turns = [COLOURS[(first + i) % len(COLOURS)] for i in range(len(COLOURS))]
        found[name] = next((colour for colour in turns if colour not in found.values()), turns[0])
    return {name: found[name] for name in names}
