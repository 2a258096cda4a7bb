"""Identification: the numbers of a connected device, measured."""
