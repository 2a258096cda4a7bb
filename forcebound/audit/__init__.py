r"""Audits of bounding laws: ground-truth energy under adversaries.

A run takes a device, a hand, an adversary and a bad clock (:mod:`forcebound.audit.cases`), drawn at
random or found by a search for the lowest energy (:mod:`forcebound.audit.search`), and integrates
them with the same plant step (:func:`forcebound.devices.plant.advance`) and the same law functions
(:data:`forcebound.bounding.LAWS`) as the live nodes, compiled. At every sub-step it records,
invisible to the law,

* the *hand's energy* :math:`\int F_h v\,dt`: non-negative in the paper's Eq. 1;
* the *loss plus work*: viscous loss, friction loss and work against the motor. It equals the hand's
  energy less the device's kinetic energy, so it is the stricter test; the certified laws guarantee
  it, too;
* the *balance* of the plant: work of the hand less the growth of kinetic energy, losses and motor
  work. Below zero by more than rounding, the integrator would generate energy, and the audit would
  be void.

The device dissipates exactly the minimum that the law assumes, so no law has a hidden reserve.
One axis.

``forcebound audit`` runs a campaign; its exit status is 1 if a certified law leaks.
``forcebound audit replay LAW CASE`` repeats one run.
"""

from forcebound.audit.campaign import run_campaign
from forcebound.audit.cases import ADVERSARIES, SENSORS, Case, case_of, dissipation_of, draw_case
from forcebound.audit.run import TRACE_COLUMNS, Result, attack, replay

__all__ = [
    "ADVERSARIES",
    "SENSORS",
    "TRACE_COLUMNS",
    "Case",
    "Result",
    "attack",
    "case_of",
    "dissipation_of",
    "draw_case",
    "replay",
    "run_campaign",
]
