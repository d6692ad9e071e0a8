"""SPIN as an independent judge: the closed loop as a Promela model, and what SPIN says of it."""
