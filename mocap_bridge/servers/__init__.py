"""Servers that replay a recording as a live system, one protocol a file."""
