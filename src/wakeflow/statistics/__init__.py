"""From landings to shares and their intervals: samples, grids, inputs, partition curves, dividers."""
