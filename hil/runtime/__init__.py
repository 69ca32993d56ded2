"""Console, threads, shutdown, result folders. May import nothing of ours but ``model.errors`` and ``model.files``."""
