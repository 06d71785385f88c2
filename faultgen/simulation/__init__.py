"""From a task to simulated cycles; the only place that steps MuJoCo."""
