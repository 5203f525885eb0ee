"""Whether the intervals hold the truth: varied scenes whose truth is known, and each part of the error by itself."""
