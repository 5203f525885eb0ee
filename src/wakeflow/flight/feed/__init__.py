"""From the feed to the first contact: what granules meet first, eq. (1)-(2) of the paper, the loads of impacts."""
