"""Proofs in time: program and plant with clocks, in whole units or in zones."""
