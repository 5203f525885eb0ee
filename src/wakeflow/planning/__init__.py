"""What a scene needs, what is left out and by which bound, and what it costs. Starts nothing heavy.

Comes in: a Scene, and the sources of the budget as what they cost. Goes out: a Plan.
May call it: every room after it; a user's plan is made in ``runs.planned``. Named ``planning``: a package ``plan``
would take the place of the public function :func:`wakeflow.plan`.
"""
