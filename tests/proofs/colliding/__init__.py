"""Granules that meet beside their peers: LIGGGHTS, OpenFOAM's DPMFoam and MPPICFoam, and kinetic theory."""
