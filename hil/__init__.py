"""Hardware in the loop, in rooms: see docs/architecture.md for what each is for and what it may import."""
