"""Launch files: reading, checks, changes and writing; :mod:`forcebound.launch` starts graphs."""
