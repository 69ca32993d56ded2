"""High Five: an avatar, or a servo arm, that meets a raised hand, in the mood you chose.

This package is the public API and nothing else; what it re-exports lives in the rooms beside it
(docs/architecture.md). May import everything.
"""
