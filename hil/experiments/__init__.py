"""Experiments with people: plans, the log of their trials, and what is found out from them."""
