"""Markers of a live or recorded person: sources, marker sets, the tracker and the human arm."""
