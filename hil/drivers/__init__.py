"""Servo buses: ``bus`` talks to servos, ``emulator`` stands in for them. May import serial and dynamixel_sdk; no
MuJoCo.
"""
