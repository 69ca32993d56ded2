"""What each command does. May import anything but the command line; benchmarks are known to ``bench`` alone."""
