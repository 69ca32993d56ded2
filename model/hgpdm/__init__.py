"""The hierarchical Gaussian process dynamical model: data, hierarchy, presets, training, and the model file.

May import ``model.gp`` and ``model.geometry``, and of ``model.online`` the contact forecast that is trained with it.
"""
