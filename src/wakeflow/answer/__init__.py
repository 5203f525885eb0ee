"""The answer out of landings: shares, the draws from which every interval is taken, the types of result.json.

Comes in: Landings, an Airflow, draws of what nobody knows exactly. Goes out: a Separation, a JointAnswer, a Result.
May call it: every room after it.
"""
