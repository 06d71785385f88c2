"""What may differ between a robot and its model: effects and numbers of the model."""
