"""Methods of isolation and detection, on data that are not those of the studies."""
