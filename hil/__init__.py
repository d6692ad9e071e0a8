"""Field links: what couples a plant, soft or real, to a process image."""
