"""Commands of the lab, which the command line finds as entry points."""
