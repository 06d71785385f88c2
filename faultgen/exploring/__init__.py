"""A page in the browser on which one changes a robot's fault and sees what its signals become."""
