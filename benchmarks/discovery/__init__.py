"""How often discovery is right, and why it is wrong."""
