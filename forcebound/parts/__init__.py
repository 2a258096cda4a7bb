"""Parts of a graph: laws, devices, operators, controllers and environments, by their kind.

:mod:`~forcebound.parts.table` finds them, :mod:`~forcebound.parts.user_module` loads those in files
of the user's own, :mod:`~forcebound.parts.contract` is what the checks of all of them share.
"""

from forcebound.parts.table import Form, Table, overridden

__all__ = ["Form", "Table", "overridden"]
