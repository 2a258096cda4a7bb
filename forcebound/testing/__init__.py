"""What users import to test parts of their own: contracts, scripted transports, one part of each.

``check_*`` asks a part what ``forcebound check`` asks, and raises an AssertionError that names the
broken promises. :func:`scripted` stands in for the line to a device, so that a test of a driver's
messages is a list of bytes. :class:`Pad`, :class:`Handle`, :class:`Passing` and :data:`HALF` are a
world, a device, a controller and a law to test others with, and to copy.
"""

# With `as` they are public here, for tools that check types, too.
from forcebound.testing.checks import check_controller as check_controller
from forcebound.testing.checks import check_device as check_device
from forcebound.testing.checks import check_environment as check_environment
from forcebound.testing.checks import check_law as check_law
from forcebound.testing.checks import check_operator as check_operator
from forcebound.testing.parts import HALF as HALF
from forcebound.testing.parts import Handle as Handle
from forcebound.testing.parts import OpenHandle as OpenHandle
from forcebound.testing.parts import Pad as Pad
from forcebound.testing.parts import Passing as Passing
from forcebound.testing.transport import AnsweredLine as AnsweredLine
from forcebound.testing.transport import Scripted as Scripted
from forcebound.testing.transport import scripted as scripted
