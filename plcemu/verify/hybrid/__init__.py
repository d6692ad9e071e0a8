"""Exact reachability of linear hybrid automata: regions with rational bounds."""
