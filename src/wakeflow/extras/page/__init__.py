"""The page to work with: ``wakeflow open`` serves it to the browser of this machine.

Comes in: a scene file, a finished run, or a folder of them.
Goes out: changed scenes, and the runs that a person asks for.
May call it: the command line.
"""

COMMANDS = ("wakeflow.extras.page.page_commands:open_",)
