"""What a scene needs, what is left out and by which bound, and what it costs. Starts nothing heavy.

Named ``planning``: a package ``plan`` would take the place of the public function :func:`wakeflow.plan`.
"""
