"""Emulated servos, byte by byte, with faults on demand. May import ``hil.drivers.bus`` for registers, packets and
rigs."""
