"""The tracker beside others: an explicit one, OpenFOAM's parcels, and a reference far finer than all of them."""
