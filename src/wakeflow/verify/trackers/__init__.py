"""A benchmark: error against run time of the tracker, of classical Runge-Kutta and of OpenFOAM's own parcels."""
