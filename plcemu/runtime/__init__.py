"""Configuration, wiring and the cycle: where the parts become one PLC."""
