"""What goes over the wire, as pure functions: bytes or descriptions in, values out, and back.

May import nothing of the other rooms, no socket and no clock.
"""
