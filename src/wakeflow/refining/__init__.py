"""Spend the next second where it lowers the error most: the way of a run to a target error of every bin share."""
