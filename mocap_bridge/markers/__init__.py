"""Marker sets as data, which set a recording's labels are of, and names of joint centres. May import ``files``."""
