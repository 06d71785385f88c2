"""The recorded motion simulated with the model: torque, its sensitivities, and the servo."""
