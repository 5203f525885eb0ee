"""Experiments with granules, measured by others, next to what the program computes of them."""
