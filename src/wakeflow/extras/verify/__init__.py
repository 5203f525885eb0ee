"""Proof: the error of a scene against its run time, and what happens at the ends of what can be asked for.

Comes in: a scene file, or the name of a proof.
Goes out: reports, of which each is a table.
May call it: the command line, the proofs of a checkout (``tests/proofs``).
"""

COMMANDS = ("wakeflow.extras.verify.verify_commands:verify",)
