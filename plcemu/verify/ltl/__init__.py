"""Linear temporal logic: formulas as automata and observers that go along with a run."""
