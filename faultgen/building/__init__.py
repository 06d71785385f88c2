"""From a plain model of an arm to a complete robot, and checks of both."""
