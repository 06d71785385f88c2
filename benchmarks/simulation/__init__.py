"""How exact the simulation is, and what its shortcuts cost."""
