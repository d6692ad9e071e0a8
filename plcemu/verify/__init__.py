"""The checker: proofs over the program that runs."""
