"""Parts of a graph: laws, devices, operators, controllers and environments, by their kind.

:mod:`~forcebound.haptics.parts.table` finds them, :mod:`~forcebound.haptics.parts.user_module`
loads those in users' files, :mod:`~forcebound.haptics.parts.contract` is what the checks
of all of them share.
"""

from forcebound.haptics.parts.table import PartShape, Table, overridden

__all__ = ["PartShape", "Table", "overridden"]
