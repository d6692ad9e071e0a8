"""The door between the world and the process image."""
