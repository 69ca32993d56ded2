"""From all markers of a person to the joint angles of the skeleton, by least squares. May import ``markers`` and
``files``.
"""
