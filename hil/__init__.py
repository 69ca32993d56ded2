"""The session: tick loop, contact correction, recording, reports and the command line."""
