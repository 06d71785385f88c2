"""The arm as rigid bodies: its torque is a linear function of its parameters."""
