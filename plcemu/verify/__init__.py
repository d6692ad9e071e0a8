"""Proofs over the program that runs: transition systems, exploration, fair cycles, schedules."""
