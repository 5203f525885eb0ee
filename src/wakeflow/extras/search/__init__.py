"""The search for the best design of a machine.

Comes in: a task, which is goals, limits, bounds and a budget, about a scene.
Goes out: the designs that were tried, the front of them, one that is recommended.
May call it: a user (``wf.search``), the command line.
"""

COMMANDS = ("wakeflow.extras.search.search_commands:search",)
