"""A recording as the files of other programs, one format a module: arrays in, bytes or files out.

May import what ``hil.recording`` may. The avatar's skin moving (GLB) is ``hil.view``'s, which has the skin.
"""
