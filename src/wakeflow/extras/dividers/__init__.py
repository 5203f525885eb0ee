"""Where the dividers of a machine should be: the most recovery of a fraction at a purity, from the landings of a run.

Comes in: a finished run, a fraction, a purity. Goes out: Dividers; over every purity a table and a figure.
May call it: a user (``wf.dividers``), the command line.
"""

COMMANDS = ("wakeflow.extras.dividers.bin_commands:bins",)
