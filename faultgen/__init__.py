"""Labelled condition-monitoring data from industrial robots that wear in MuJoCo."""
