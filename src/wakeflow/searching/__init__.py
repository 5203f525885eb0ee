"""Design search: the scene that is best by its goals within bounds and a budget, coarse rungs first."""
