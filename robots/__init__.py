"""Robot models: a folder each, with the MJCF, its tasks and the source of every number."""
