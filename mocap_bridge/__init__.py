"""Markers of a live or recorded person, in rooms: ``wire``, ``sources``, ``servers``, ``markers``, ``files``,
``tracking``, ``body``.

May import ``model.geometry`` and the protocols' own libraries; never MuJoCo, serial ports or ``hil``.
"""
