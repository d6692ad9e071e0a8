"""Field links and hardware-in-the-loop benches (a later part; nothing here yet)."""
