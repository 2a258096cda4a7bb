"""The league: every method on the same devices, worlds, networks and attacks."""
