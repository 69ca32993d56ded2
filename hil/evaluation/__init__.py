"""Cross-validation, score tables, and mixtures of styles. May import ``hil.datasets`` and ``hil.session``."""
