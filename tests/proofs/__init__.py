"""The room of proofs: what shows that the program is right, apart from the program."""
