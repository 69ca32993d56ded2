"""The simulated pair: actors, emotions, and the capture of a data set from them. May import ``hil.sim`` and
``mocap_bridge``.
"""
