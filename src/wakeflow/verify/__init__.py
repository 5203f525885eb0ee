"""Proof: exact problems, and the tracker's error against its run time beside other trackers."""
