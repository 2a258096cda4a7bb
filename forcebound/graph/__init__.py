"""Launch files: reading, checks, changes and writing; :mod:`forcebound.run` starts graphs."""
