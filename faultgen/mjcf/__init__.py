"""What a robot's MJCF file must hold, and how it is compiled safely."""
