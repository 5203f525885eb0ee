"""The materials of granules, to look up and to write one's own.

Comes in: the shipped materials, or a file of a user's. Goes out: tables on a screen, a commented file to fill in.
May call it: the command line.
"""

COMMANDS = ("wakeflow.extras.materials.catalogue:materials",)
