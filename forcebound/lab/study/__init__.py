"""User studies: what a study file asks for, sessions of participants, simulated ones, analysis."""
