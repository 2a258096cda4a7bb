"""Emulators: what plays the board of a device on a pseudo-terminal."""
