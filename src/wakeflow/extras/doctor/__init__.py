"""What a run needs, tried in small: ``wakeflow doctor``.

Comes in: nothing. Goes out: a Finding of each thing, with the command that mends it.
May call it: the command line.
"""

COMMANDS = ("wakeflow.extras.doctor.doctor_commands:doctor",)
