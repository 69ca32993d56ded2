"""A host's end of a servo bus: registers as data, packets, port, joints, and a process of its own.

Another arm is another ``rig.toml``; another servo is a table in ``control_tables.toml``.
"""
