"""Recordings and the files they come in: C3D, the raw file of a live take, the table of a data folder.

May import of ``wire`` only what tells lost samples.
"""
