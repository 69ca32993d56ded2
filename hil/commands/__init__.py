"""What each command does. May import anything but benchmarks and the command line."""
