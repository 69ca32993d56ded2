"""Every benchmark, and the external baselines. May import anything below; imported by the command line alone."""
