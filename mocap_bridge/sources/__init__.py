"""Where marker frames come from, one file per protocol: the one interface, live connections, and addresses.

A new protocol is a file here, and its bytes a file in ``wire``. May import ``wire`` and ``files``.
"""
