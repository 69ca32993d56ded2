"""Figures, pages and films, with one look for all. May import whatever they show; no command and no benchmark."""
