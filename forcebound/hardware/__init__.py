"""Hardware: drivers of devices on serial ports, and what keeps their last force from staying on.

A driver is a :class:`forcebound.haptics.devices.DeviceModel` like any other, with one line in
``forcebound.haptics.devices.DEVICES``; docs/write-your-own-device.md says what it promises.
"""
