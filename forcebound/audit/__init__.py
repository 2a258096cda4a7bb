r"""Audits of bounding laws: ground-truth energy under adversaries.

A run takes a device, a hand, an adversary and a bad clock (:mod:`forcebound.audit.cases`), drawn at
random or found by a search for the lowest energy (:mod:`forcebound.audit.search`), and integrates
them in the compiled loop of sweeps (:mod:`forcebound.lab.one_axis`), with the plant step and the
laws of the live nodes. At every sub-step it records, invisible to the law,

* the *hand's energy* :math:`\int F_h v\,dt`: non-negative in the paper's Eq. 1;
* the *loss plus work*: viscous loss, friction loss and work against the motor. It equals the hand's
  energy less the device's kinetic energy, so it is the stricter test; the certified laws guarantee
  it, too;
* the *balance* of the plant: work of the hand less the growth of kinetic energy, losses and motor
  work. Below zero by more than rounding, the integrator would generate energy, and the audit would
  be void.

The device dissipates exactly the minimum that the law assumes, so no law has a hidden reserve.
One axis.

Certificates, for what real devices do besides (:mod:`forcebound.audit.certificates`), are attacked
along freely chosen paths without inertia (:mod:`forcebound.audit.paths`), whose energy is known in
closed form (:mod:`forcebound.audit.truth`); the law is the live bounder.

``forcebound audit`` runs both campaigns; its exit status is 1 if a certified law leaks.
``forcebound audit replay LAW CASE`` repeats one run.
"""

from forcebound.audit.campaign import run_campaign
from forcebound.audit.cases import ADVERSARIES, SENSORS, Case, case_of, dissipation_of, draw_case
from forcebound.audit.certificates import CERTIFICATES
from forcebound.audit.certify import run_certificates
from forcebound.audit.path_run import PathResult, attack_path, replay_path
from forcebound.audit.paths import PathCase, path_case_of
from forcebound.audit.run import TRACE_COLUMNS, Result, attack, replay

__all__ = [
    "ADVERSARIES",
    "CERTIFICATES",
    "SENSORS",
    "TRACE_COLUMNS",
    "Case",
    "PathCase",
    "PathResult",
    "Result",
    "attack",
    "attack_path",
    "case_of",
    "dissipation_of",
    "draw_case",
    "path_case_of",
    "replay",
    "replay_path",
    "run_campaign",
    "run_certificates",
]
