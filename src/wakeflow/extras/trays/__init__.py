"""Measured trays: what they say of the numbers of a scene, and which to weigh next.

Comes in: a scene and the shares that were weighed or counted.
Goes out: a Posterior (inputs and shares as known now, materials for the next scene), a protocol.
May call it: a user (``wf.calibrate``), the command line, the page.
"""

COMMANDS = (
    "wakeflow.extras.trays.tray_commands:calibrate",
    "wakeflow.extras.trays.tray_commands:protocol",
)
