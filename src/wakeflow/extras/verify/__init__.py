"""Proof: the error of a scene against its run time, what happens at the ends of what can be asked for, and all else.

Comes in: a scene file, or the name of a proof.
Goes out: the reports of a checkout's room of proofs (``tests/proofs``), which needs no installation of its own.
May call it: the command line.
"""

COMMANDS = ("wakeflow.extras.verify.verify_commands:verify",)
