"""Identification: the numbers that the certificate rests on, measured on a device.

1. :mod:`~forcebound.identification.rig` reads and writes the device at a steady rate, within limits
   of force, speed and reach, on a clock that is passed in: real time, or virtual for a simulation.
2. :mod:`~forcebound.identification.drive` moves an axis along a prescribed way;
   :mod:`~forcebound.identification.experiments` returns what each experiment has measured.
3. :mod:`~forcebound.identification.estimators` turns that into numbers and bounds. It is pure.
4. :mod:`~forcebound.identification.procedure` does all of it in order.
5. :mod:`~forcebound.identification.document` writes ``device.yaml``;
   :mod:`~forcebound.identification.verdict` says what the certified law will show.

Bounds are on the careful side: lower for what dissipates, upper for what errs, over the whole range
that was measured. Forces are those that the motors are commanded; ``docs/identify.md`` says why
that will do.
"""
