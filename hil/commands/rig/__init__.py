"""What ``highfive rig`` does: scan, configure, check, play, reach, release, emulate."""
