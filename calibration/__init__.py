"""Pure fits that tie motion capture, avatar and rig together."""
