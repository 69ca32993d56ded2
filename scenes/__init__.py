"""MJCF and the constants that belong to it."""
