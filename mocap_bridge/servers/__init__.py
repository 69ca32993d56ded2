"""A recording sent out as a live system would send it, one protocol a file, with faults on demand.

May import ``wire``, ``files`` and what ``sources`` knows of a protocol.
"""
