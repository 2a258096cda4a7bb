"""Hardware: drivers of devices on serial ports, and what keeps their last force from staying on.

A driver is a :class:`forcebound.devices.DeviceModel` like any other, with one line in
``forcebound.devices.DEVICES``; docs/write-your-own-device.md says what it promises.
"""
