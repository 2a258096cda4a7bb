"""The parts of a loop: laws, devices, hands, controllers, environments."""
