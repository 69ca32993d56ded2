"""The live page: what a session or a recording shows in a browser, its messages, its server, and the files it serves.

May import session and trial values, the scene, and recordings; nobody below imports it.
"""

from pathlib import Path

SHIPPED_RECORDING = Path(__file__).parent / "shipped.mcap"
"""Four high fives, one in each emotion; ``make recording`` makes it again."""
