"""Every benchmark, and the external baselines. May import anything below; imported by ``commands.bench`` alone."""
