"""Files of MediaPipe Pose and Hands, with their SHA-256 in ``files.json``; see the README."""
