"""Studies of one machine by many runs: which input moves which number, the map of what an operator turns, the capacity.

Comes in: a scene, a scene file, a finished run. Goes out: a Sensitivity, a Sweep with its figure.
May call it: a user (``wf.sensitivity``), the command line, the page.
"""

COMMANDS = (
    "wakeflow.extras.studies.study_commands:sensitivity",
    "wakeflow.extras.studies.study_commands:map_",
    "wakeflow.extras.studies.study_commands:capacity",
)
